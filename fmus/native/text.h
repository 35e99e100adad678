/* Lines for the log: numbers look the same in every locale. */

#ifndef TEXT_H
#define TEXT_H

#include <stdarg.h>

#include "unit.h"

#define compose fmi2FullName(compose)

/* Fill `line` (TEXT_SIZE bytes) from a format with
     %s a string, %q one in quotes, what is not printable ASCII or is a % replaced by ?
     %d an int, %z a size_t, %r a double with all its digits as Python writes it,
     %.<n>f and %.<n>g a double as printf does.
   What does not fit is cut off. */
SHARED void compose(char *line, const char *format, va_list values);

#endif
