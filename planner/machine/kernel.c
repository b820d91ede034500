/* Replays of manipulators: lanes.h, contacts.h and chain.h for one machine, wide.c for sixteen.
 *
 * Plain C99 without Python: built as an optional extension, loaded by compiled.py through ctypes.
 */

#define W 1
#define CLONES
#define ADVANCE planner_advance_single
#include "chain.h"

#define WIDE 16 /* machines at once in wide.c */
#define FEW 7   /* fewer machines are faster one by one */

/* Defined in wide.c. */
int planner_advance_wide(const Model *m, const Commands *u, int64_t begin, int64_t end, int64_t first,
                         int64_t last);

EXPORT int64_t planner_kernel_version(void) { return VERSION; }

/* Checksum of the sources by setup.py: an old kernel may have the same layout. */
EXPORT int64_t planner_kernel_source(void) { return SOURCE; }

/* The cosines that replays compute with, for the tests. */
EXPORT void planner_cosines(int64_t count, const double *x, double *out)
{
    for (int64_t i = 0; i < count; i++)
        cosines(x + i, out + i);
}

/* Advance samples begin ... end - 1 by the steps first ... last - 1; return -1 if out of memory. */
EXPORT int planner_advance(const Model *m, const Commands *u, int64_t begin, int64_t end,
                           int64_t first, int64_t last)
{
    int64_t rest = (end - begin) % WIDE, whole = m->dynamic ? begin : rest < FEW ? end - rest : end;
    return planner_advance_wide(m, u, begin, whole, first, last)
           || planner_advance_single(m, u, whole, end, first, last) ? -1 : 0;
}
