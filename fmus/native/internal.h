/* Linkage of what the files of a unit share.

   A unit ships as one C file that defines SINGLE_FILE: everything but the FMI functions is static there, so that
   several units link into one program. Without it each file here compiles on its own. */

#ifndef INTERNAL_H
#define INTERNAL_H

#if !defined(SINGLE_FILE)
#define INTERNAL extern /* in front of a declaration */
#define INTERNAL_DATA   /* in front of the definition of data; functions take the linkage of their declaration */
#elif defined(__GNUC__)
#define INTERNAL static __attribute__((unused))
#define INTERNAL_DATA static
#else
#define INTERNAL static
#define INTERNAL_DATA static
#endif

/* In front of the definition of a small function in a header. */
#if defined(__GNUC__)
#define INTERNAL_INLINE static inline __attribute__((unused))
#else
#define INTERNAL_INLINE static inline
#endif

/* In front of the definition of a large function that runs when a unit is set up: it stays out of its caller, which
   takes clang a third of the time to compile. */
#if defined(__GNUC__)
#define NOT_INLINED __attribute__((noinline))
#else
#define NOT_INLINED
#endif

/* Begins a table on a cache line, where the compiler knows how. */
#if defined(__GNUC__)
#define ALIGNED __attribute__((aligned(64)))
#else
#define ALIGNED
#endif

#endif
