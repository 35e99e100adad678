/* Counts that the compiler is told, so that it unrolls loops and keeps their sums in registers. */
#ifndef FLEXBEAMS_ROW_WIDTHS_H
#define FLEXBEAMS_ROW_WIDTHS_H

#include <stddef.h>

#if defined(__AVX512F__)
#define CHUNK 12 /* rows that are summed side by side, at most: registers hold two sums of each */
#else
#define CHUNK 6
#endif

#define COUNTS 12 /* that are written out */

/* Chunks of `rows`, as few as there may be, and the rows of each: all are equally wide. */
static inline size_t chunk_count(size_t rows)
{
    return (rows + CHUNK - 1) / CHUNK;
}

static inline size_t chunk_width(size_t rows)
{
    return rows == 0 ? 0 : (rows + chunk_count(rows) - 1) / chunk_count(rows);
}

#define AT_ONE(number, function, ...)                                                                                  \
    case number:                                                                                                       \
        function(number, __VA_ARGS__);                                                                                 \
        break;
/* function(count, ...), with counts up to COUNTS written out. */
#define AT_COUNT(count, function, ...)                                                                                 \
    switch (count) {                                                                                                   \
        AT_ONE(1, function, __VA_ARGS__)                                                                               \
        AT_ONE(2, function, __VA_ARGS__)                                                                               \
        AT_ONE(3, function, __VA_ARGS__)                                                                               \
        AT_ONE(4, function, __VA_ARGS__)                                                                               \
        AT_ONE(5, function, __VA_ARGS__)                                                                               \
        AT_ONE(6, function, __VA_ARGS__)                                                                               \
        AT_ONE(7, function, __VA_ARGS__)                                                                               \
        AT_ONE(8, function, __VA_ARGS__)                                                                               \
        AT_ONE(9, function, __VA_ARGS__)                                                                               \
        AT_ONE(10, function, __VA_ARGS__)                                                                              \
        AT_ONE(11, function, __VA_ARGS__)                                                                              \
        AT_ONE(12, function, __VA_ARGS__)                                                                              \
    default:                                                                                                           \
        function(count, __VA_ARGS__);                                                                                  \
        break;                                                                                                         \
    }

#endif
