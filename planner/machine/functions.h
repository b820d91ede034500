/* Cosines, sines and exponentials of sums and products only: those of libm have other bits on other
 * processors, and no lanes. */

#include <float.h>
#include <math.h>

#include "layout.h"

/* Of an angle: n, the nearest number of quarters of a turn, modulo 4 as -2 ... 2, and sine and cosine
 * of the rest. Right to 1.6 of the last bit's unit (2.4 at 1e6 rad): x less n quarters in three parts
 * (n times the first two, of 33 bits, is exact), then minimax polynomials to an eighth of a turn. */
typedef struct {
    double quadrant, sine, cosine;
} Turn;

INLINE Turn turn_of(double x)
{
    const double QUARTER_1 = 1.5707963267341256, QUARTER_2 = 6.077100506303966e-11;
    const double QUARTER_3 = 2.0222662487959506e-21, BY_QUARTER = 0.6366197723675814;
    const double NEAREST = 6755399441055744.0; /* 1.5 x 2^52: sums have no fraction */
    double n = (x * BY_QUARTER + NEAREST) - NEAREST;
    double r = ((x - n * QUARTER_1) - n * QUARTER_2) - n * QUARTER_3;
    double z = r * r, zz = z * z, z4 = zz * zz, half = z * 0.5, most = 1 - half;
    double odd = (-1.6666666666666642e-1 + z * 8.333333333323662e-3)
                 + zz * (-1.9841269830144396e-4 + z * 2.7557313651853934e-6)
                 + z4 * (-2.5050734571184192e-8 + z * 1.5894710588084432e-10);
    double even = (4.166666666666665e-2 - z * 1.388888888888288e-3)
                  + zz * (2.4801587294628004e-5 - z * 2.75573157386131e-7)
                  + z4 * (2.087589773865943e-9 - z * 1.1367981879283299e-11);
    Turn turn;
    turn.quadrant = n - 4 * ((n * 0.25 + NEAREST) - NEAREST);
    turn.sine = r + r * z * odd;
    turn.cosine = most + (((1 - most) - half) + zz * even);
    return turn;
}

#if FLT_EVAL_METHOD == 0
INLINE double cosine_of(double x)
{
    Turn turn = turn_of(x);
    double turned = fabs(turn.quadrant);
    return turned == 1 ? -turn.quadrant * turn.sine : (1 - turned) * turn.cosine;
}

INLINE double sine_of(double x)
{
    Turn turn = turn_of(x);
    double turned = fabs(turn.quadrant);
    return turned == 1 ? turn.quadrant * turn.cosine : (1 - turned) * turn.sine;
}
#else /* the reduction needs sums that are rounded, as x87 registers do not */
#define cosine_of cos
#define sine_of sin
#endif

/* exp(x) - part for x <= 0 and a part of 0 or 1: x less n times ln 2, then Taylor's series, whose
 * 14th term is below the last bit. */
INLINE double decay(double x, double part)
{
    const double LN2_1 = 6.93147180369123816490e-01, LN2_2 = 1.90821492927058770002e-10;
    if (x < -700)
        return 0.0 - part;
    double n = floor(x / (LN2_1 + LN2_2) + 0.5), r = (x - n * LN2_1) - n * LN2_2, sum = 0.0;
    for (int k = 14; k > 0; k--)
        sum = (r + r * sum) / k; /* (exp(r) - 1) from its last terms on: r/k (1 + ...) */
    double scale = ldexp(1.0, (int)n);
    return scale * sum + (scale - part);
}
