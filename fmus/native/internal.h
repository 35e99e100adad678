/* Linkage of what the files of a unit share.

   A unit ships as one C file that defines SINGLE_FILE: everything but the FMI functions is static there, so that
   several units link into one program. Without it each file here compiles on its own.

   Where many designs are built, the code of that file is compiled once (CODE_ONLY) and its tables for each design
   (TABLES_ONLY); these two see each other's hooks and description of the unit, which are SHARED. */

#ifndef INTERNAL_H
#define INTERNAL_H

/* In front of the declaration of a function; its definition takes the same linkage. */
#if !defined(SINGLE_FILE) || defined(TABLES_ONLY)
#define INTERNAL extern
#elif defined(__GNUC__)
#define INTERNAL static __attribute__((unused))
#else
#define INTERNAL static
#endif

/* In front of the declaration of data, and of their definition. */
#if !defined(SINGLE_FILE) || defined(CODE_ONLY) || defined(TABLES_ONLY)
#define SHARED extern
#define SHARED_DATA
#else
#define SHARED INTERNAL
#define SHARED_DATA static
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
