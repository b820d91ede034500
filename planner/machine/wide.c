/* The quasi-static manipulator for sixteen machines at once. Where the C library can choose code when
 * it is loaded, wide registers of the processor are used; the bits are the same. */

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("no-trapping-math") /* else loops with quotients in conditions stay scalar */
#endif

#include <stdlib.h>

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define CLONES __attribute__((target_clones("default", "avx2")))
#else
#define CLONES
#endif
#define W 16
#define ADVANCE planner_advance_wide
#include "chain.h"
