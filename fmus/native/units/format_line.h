/* Lines for the log: numbers look the same in every locale. */

#ifndef FORMAT_LINE_H
#define FORMAT_LINE_H

#include <stdarg.h>
#include <stddef.h>

#include "internal.h"

/* Fill `line` (size,) from a format. Of printf's forms it knows, with printf's meaning,

     %s        const char *, a string: what is not printable ASCII or is a % becomes ?
     %d        int
     %zu       size_t
     %.<n>f    double with n decimals, n one digit
     %.<n>g    double with n significant digits, n one digit

   and two forms of its own:

     %q        const char *, a string as %s, in single quotes, at most 80 characters
     %r        double with the fewest digits that read back as the same number, as Python writes it

   What does not fit is cut off. */
INTERNAL void format_line(char *line, size_t size, const char *format, va_list values);

#endif
