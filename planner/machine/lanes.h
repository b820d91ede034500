/* What the quasi-static manipulator needs in C, over W machines at once: the servos of servos.py
 * here, contacts.h and chain.h after it. The Python modules explain the computation; the names here
 * are theirs. Both give the same numbers to within rounding (tests/machine/test_kernel.py).
 *
 * A quantity of W machines is a lane: W numbers in a row. Loops over lanes are innermost and without
 * branches, so that the compiler makes vectors of them; conditions on effects stand outside. Every
 * width gives the same bits: the W numbers of a lane never meet.
 */

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "functions.h"

#if defined(__clang__)
#define LANES _Pragma("clang loop vectorize(assume_safety)") for (int l = 0; l < W; l++)
#elif defined(__GNUC__)
#define LANES _Pragma("GCC ivdep") for (int l = 0; l < W; l++)
#else
#define LANES for (int l = 0; l < W; l++)
#endif
#define ROW(lanes, i) ((lanes) + (i) * W)
#define KEPT 8   /* number of step lengths whose factors are kept */
#define POINTS 3 /* largest number of points in a step */

typedef double Lane[W];

static const double SPEED_TOLERANCE_RAD_S = 1e-12;

/* Factors that depend only on the length of a step: (2 x 4) of the servos, 2 for each joint from 2. */
typedef struct {
    double length;
    Lane servo[MOTORS][4];
    double *weight; /* (joints - 1, 2) */
} Factors;

INLINE double between(double x, double low, double high)
{
    double y = x > low ? x : low;
    return y < high ? y : high;
}

INLINE double clip(double x, double most)
{
    double y = x > most ? most : x;
    return y < -most ? -most : y;
}

INLINE void cosines(const double *x, double *out)
{
    LANES out[l] = cosine_of(x[l]);
}

/* -- factors of a step's length ------------------------------------------------------------ */

/* Entries of exp([[0, 1], [-b^2, -2 z b]] h), for any damping. */
static void oscillator(double b, double z, double h, double *e)
{
    double d = z * z - 1, root = b * sqrt(fabs(d)), fade = decay(-z * b * h, 0), cosh_, sinh_;
    if (root * h < 1e-6) {
        cosh_ = fade;
        sinh_ = h * fade;
    } else if (d < 0) {
        cosh_ = fade * cosine_of(root * h);
        sinh_ = fade * sine_of(root * h) / root;
    } else {
        double slow = decay((root - z * b) * h, 0), fast = decay((-root - z * b) * h, 0);
        cosh_ = (slow + fast) / 2;
        sinh_ = (slow - fast) / (2 * root);
    }
    double spin = z * b * sinh_;
    e[0] = cosh_ + spin;
    e[1] = sinh_;
    e[2] = -(b * b) * sinh_;
    e[3] = cosh_ - spin;
}

static void factors(const Model *m, const Own *o, double h, Factors *f)
{
    double part = h / (double)(m->points - 1), entry[4];
    int64_t last = m->joints - 2;
    f->length = h;
    for (int i = 0; i < MOTORS && m->lagging; i++)
        for (int l = 0; l < W; l++) {
            double b = ROW(o->servo_bandwidth_rad_s, i)[l];
            if (m->second)
                oscillator(b, ROW(o->servo_damping, i)[l], part, entry);
            else
                entry[0] = decay(-b * part, 0);
            for (int e = 0; e < (m->second ? 4 : 1); e++)
                f->servo[i][e][l] = entry[e];
        }
    for (int64_t j = 0; j <= last && m->lagged; j++)
        for (int l = 0; l < W; l++) {
            double viscous = ROW(o->viscous_friction_nms_per_rad, j)[l];
            double lag = viscous / ROW(o->shaft_stiffness_nm_per_rad, j)[l] / (j < last ? part : h);
            double mean = lag > 0 ? -lag * decay(-1 / lag, 1) : 0.0;
            double settled = lag > 0 ? -decay(-1 / lag, 1) : 1.0;
            ROW(f->weight, 2 * j)[l] = settled - (1 - mean);
            ROW(f->weight, 2 * j + 1)[l] = 1 - mean;
        }
}

/* -- servos -------------------------------------------------------------------------------- */

INLINE void first_order(const Lane *e, const double *b, const double *r0, const double *r1, double h,
                        const double *before, double *after, double *travel)
{
    Lane behind = {0};
    if (r0 != r1) /* a held command costs no quotient */
        LANES behind[l] = (r1[l] - r0[l]) / (h * b[l]);
    LANES {
        double gap = before[l] - r0[l] + behind[l], left = gap * e[0][l];
        travel[l] = (r0[l] + r1[l]) * (h / 2) - behind[l] * h + (gap - left) / b[l];
        after[l] = r1[l] - behind[l] + left;
    }
}

INLINE void second_order(const Lane *e, const double *b, const double *z, const double *r0,
                         const double *r1, double h, const double *before, double *slope,
                         double *after, double *travel)
{
    LANES {
        double twice = 2 * z[l] / b[l], rate = (r1[l] - r0[l]) / h;
        double x = before[l] - r0[l] + twice * rate, y = slope[l] - rate;
        double left = e[0][l] * x + e[1][l] * y, left_slope = e[2][l] * x + e[3][l] * y;
        slope[l] = left_slope + rate;
        travel[l] = (r0[l] + r1[l]) * (h / 2) - twice * rate * h + (y - left_slope) / (b[l] * b[l])
                    + twice * (x - left);
        after[l] = r1[l] - twice * rate + left;
    }
}

/* Advance motor i by h for a reference from r0 to r1. */
INLINE void motor(const Model *m, const Own *o, const Held *x, const Factors *f, int i,
                  const double *r0, const double *r1, double h, double *travel)
{
    const double *b = ROW(o->servo_bandwidth_rad_s, i), *limit = ROW(o->velocity_limit_rad_s, i);
    const double *ramp = ROW(o->acceleration_limit_rad_s2, i);
    double *speed = ROW(x->speed, i), *slope = ROW(x->slope, i);
    Lane before, free_, now;
    memcpy(before, speed, sizeof(Lane));
    if (!m->lagging)
        LANES {
            travel[l] = (r0[l] + r1[l]) * (h / 2);
            free_[l] = r1[l];
        }
    else if (m->second)
        second_order(f->servo[i], b, ROW(o->servo_damping, i), r0, r1, h, before, slope, free_, travel);
    else
        first_order(f->servo[i], b, r0, r1, h, before, free_, travel);
    memcpy(now, free_, sizeof(Lane));
    if (m->second && m->limited)
        LANES now[l] = clip(free_[l], limit[l]);
    if (m->ramped)
        LANES now[l] = before[l] + clip(now[l] - before[l], ramp[l] * h);
    if (m->ramped && !m->lagging)
        LANES travel[l] -= (r0[l] - before[l]) * fabs(r0[l] - before[l]) / (2 * ramp[l]);
    LANES {
        double mean = (before[l] + now[l]) * (h / 2);
        travel[l] = fabs(now[l] - free_[l]) > SPEED_TOLERANCE_RAD_S ? mean : travel[l];
        speed[l] = now[l];
    }
    if (m->second)
        LANES {
            double mean = (now[l] - before[l]) / h;
            slope[l] = fabs(now[l] - free_[l]) > SPEED_TOLERANCE_RAD_S ? mean : slope[l];
        }
}

/* Integrals from a step's start to each later point; see `integrals` of servos.py. */
INLINE void integrals(int64_t points, const Lane *f, double h, Lane *out)
{
    if (points == 2)
        LANES out[0][l] = (h / 2) * (f[0][l] + f[1][l]);
    else
        LANES {
            double f0 = f[0][l], f1 = f[1][l], f2 = f[2][l];
            out[0][l] = (5 * h / 24) * f0 + (8 * h / 24) * f1 - (h / 24) * f2;
            out[1][l] = (h / 6) * (f0 + f2) + (4 * h / 6) * f1;
        }
}

/* Advance motor i by a step: its speed at the points, its travel to each later point. The
 * places from `mine` on repeat the last sample. */
INLINE void servo(const Model *m, const Own *o, const Held *x, const Factors *f, int i,
                  const Commands *u, const double *command, int64_t mine, int running, double h,
                  Lane *speed, Lane *travel)
{
    const double *limit = ROW(o->velocity_limit_rad_s, i), *gain = ROW(o->gain, i);
    const double *bias = ROW(o->input_bias_rad_s, i);
    double *saturated = ROW(x->saturated, i), on = running ? 1.0 : 0.0;
    Lane r[POINTS], way;
    int64_t points = m->points;
    int held = points == 2 && (u->sample == 0 || W == 1) && command[0] == command[u->point];
    for (int64_t p = held; p < points; p++) {
        const double *at = command + p * u->point;
        if (u->sample == 0)
            LANES way[l] = *at;
        else
            for (int l = 0; l < W; l++)
                way[l] = at[(l < mine ? l : mine - 1) * u->sample];
        LANES way[l] = gain[l] * way[l] + on * bias[l];
        if (p == points / 2)
            LANES saturated[l] += fabs(way[l]) > limit[l] ? h : 0.0;
        LANES r[p][l] = clip(way[l], limit[l]);
    }
    if (!m->lagging && !m->ramped) {
        for (int64_t p = 0; p < points; p++)
            memcpy(speed[p], r[held ? 1 : p], sizeof(Lane));
        integrals(points, (const Lane *)speed, h, travel);
        return;
    }
    memcpy(speed[0], ROW(x->speed, i), sizeof(Lane));
    for (int64_t p = 0; p + 1 < points; p++) {
        motor(m, o, x, f, i, r[held ? 1 : p], r[p + 1], h / (double)(points - 1), way);
        LANES travel[p][l] = p ? travel[p - 1][l] + way[l] : way[l];
        memcpy(speed[p + 1], ROW(x->speed, i), sizeof(Lane));
    }
}
