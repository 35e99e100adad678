#include "format_line.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER_SIZE 96
#define LONGEST_QUOTE 80 /* characters of a quoted string */

/* Put a point where the locale has its own sign. */
static void use_point(char *number)
{
    char *sign = number + strspn(number, "+-0123456789");
    if (*sign == '\0' || *sign == 'e')
        return;
    char *rest = sign + strcspn(sign, "0123456789");
    *sign = '.';
    memmove(sign + 1, rest, strlen(rest) + 1);
}

static bool write_special(char *number, double value)
{
    if (isfinite(value))
        return false;
    strcpy(number, isnan(value) ? "nan" : value > 0 ? "inf" : "-inf");
    return true;
}

/* The shortest digits that read back as the same value, in the notation that Python chooses. */
static void write_shortest(char *number, double value)
{
    if (write_special(number, value))
        return;
    int digits = 1;
    for (;; digits++) {
        snprintf(number, NUMBER_SIZE, "%.*e", digits - 1, value);
        if (digits == 17 || strtod(number, NULL) == value)
            break;
    }
    const int exponent = atoi(strchr(number, 'e') + 1);
    if (exponent >= -4 && exponent < 16) {
        const int decimals = digits - 1 - exponent;
        snprintf(number, NUMBER_SIZE, "%.*f", decimals > 1 ? decimals : 1, value);
    }
    use_point(number);
}

/* As printf with %.<digits>f or %.<digits>g, of at most 17 digits. */
static void write_rounded(char *number, double value, char style, int wanted)
{
    if (write_special(number, value))
        return;
    const int digits = wanted < 17 ? wanted : 17;
    if (style == 'f' && fabs(value) < 1e15)
        snprintf(number, NUMBER_SIZE, "%.*f", digits, value);
    else
        snprintf(number, NUMBER_SIZE, "%.*g", digits, value);
    use_point(number);
}

/* At most `most` characters behind the first `length` ones of a line (size,); the new length. */
static size_t append(char *line, size_t size, size_t length, const char *words, size_t most)
{
    for (; *words != '\0' && most > 0 && length + 1 < size; words++, most--)
        line[length++] = *words >= ' ' && *words <= '~' && *words != '%' ? *words : '?';
    line[length] = '\0';
    return length;
}

void format_line(char *line, size_t size, const char *format, va_list values)
{
    char number[NUMBER_SIZE];
    size_t length = append(line, size, 0, "", 0);
    while (*format != '\0') {
        const size_t plain = strcspn(format, "%");
        length = append(line, size, length, format, plain);
        format += plain;
        if (*format == '\0')
            break;
        int digits = 0;
        if (*++format == '.') {
            digits = format[1] - '0';
            format += 2;
        }
        const char *words = number;
        const bool is_quoted = *format == 'q';
        switch (*format) {
        case 's':
        case 'q':
            words = va_arg(values, const char *);
            break;
        case 'd':
            snprintf(number, sizeof number, "%d", va_arg(values, int));
            break;
        case 'z':
            snprintf(number, sizeof number, "%lu", (unsigned long)va_arg(values, size_t));
            format++; /* the u */
            break;
        case 'r':
            write_shortest(number, va_arg(values, double));
            break;
        default:
            write_rounded(number, va_arg(values, double), *format, digits);
        }
        if (is_quoted)
            length = append(line, size, length, "'", 1);
        length = append(line, size, length, words, is_quoted ? LONGEST_QUOTE : size);
        if (is_quoted)
            length = append(line, size, length, "'", 1);
        format++;
    }
}
