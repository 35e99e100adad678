/* Prints numbers as the log of a unit does: texts LOCALE NUMBER... */

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>

#include "format_line.h"

static void show(const char *format, ...)
{
    char line[256];
    va_list values;
    va_start(values, format);
    format_line(line, sizeof line, format, values);
    va_end(values);
    puts(line);
}

int main(int argc, char **argv)
{
    double numbers[4096];
    int count = 0;
    for (int k = 2; k < argc && count < 4096; k++)
        numbers[count++] = strtod(argv[k], NULL);
    if (setlocale(LC_ALL, argc > 1 ? argv[1] : "C") == NULL)
        return 2;
    for (int k = 0; k < count; k++)
        show("%r %.6g %.1f", numbers[k], numbers[k], numbers[k]);
    show("%q %d %zu", "100 %s\n", -3, (size_t)7);
    return 0;
}
