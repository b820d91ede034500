/* The replay that a hand would write for one machine alone: the prototype preset, three joints, a
 * held command with one delay for all. Nothing can be switched on or off. See replay.py.
 */

#include <math.h>

enum { BACKLASH = 12, STIFFNESS = 14, COULOMB = 16, VISCOUS = 18, LATERAL = 20, COUNT = 21 };

static double clip(double x, double m) { return x > m ? m : x < -m ? -m : x; }
static double low(double a, double b) { return a < b ? a : b; }
static double high(double a, double b) { return a > b ? a : b; }

/* A contact of cosine c whose sliding sideways is s = lateral |sin|: what its driver feels. */
static double felt(double load, double c, double s, double capacity)
{
    load = high(low(load, capacity * c / sqrt(c * c + s * s)), -0.99 * capacity);
    return load * c + s * sqrt(high(capacity * capacity - load * load, 0));
}

/* And the part of its rate that it passes on. */
static double passed(double load, double c, double s, double capacity, double creep, double per)
{
    double most = capacity * c / sqrt(c * c + s * s), kept = high(load, -0.99 * capacity);
    if (load >= most)
        return 0;
    kept = 1 - s * kept / (c * sqrt(high(capacity * capacity - kept * kept, 1e-60)));
    return high(kept, 0) * high(1 - creep - per * low(fabs(load), capacity), 0);
}

/* Parameters (samples, 21): gain 2, bias 2, creep, creep per N m, capacity, k 2, half gap of the
 * gearheads 2, start in play (unused), then 2 each of half gap, stiffness, coulomb, viscous; lateral.
 * Commands (steps, 2), desired (steps + 1, 3), row (steps + 1) or -1, start (samples, 6): phi,
 * theta 3, axis 2; q (samples, rows, 4), gap (samples, 3).
 */
void replay(int samples, int steps, int rows, double h, double bandwidth, double limit, double ramp,
            double k_g, const double *parameters, const double *commands,
            const unsigned char *running, const double *desired, const int *row,
            const double *start, double *q, double *speed, double *gap)
{
    double decay = exp(-bandwidth * h), most = ramp * h;
    for (int s = 0; s < samples; s++) {
        const double *p = parameters + s * COUNT, *x = start + s * 6;
        double w1 = 0, w2 = 0, phi = x[0], disk = 0, disk_axis = 0;
        double t1 = x[1], a1 = x[1], t2 = x[2], a2 = x[4], t3 = x[3], a3 = x[5], d2 = 0, d3 = 0;
        double k2 = p[7], k3 = p[8], ratio = k3 / k2, creep = p[4], per = p[5], capacity = p[6];
        double g2 = p[BACKLASH], g3 = p[BACKLASH + 1], s2 = p[STIFFNESS], s3 = p[STIFFNESS + 1];
        double rest2 = g2 + p[COULOMB] / s2, rest3 = g3 + p[COULOMB + 1] / s3;
        double lag2 = p[VISCOUS] / s2 / h, lag3 = p[VISCOUS + 1] / s3 / h;
        double mean2 = -lag2 * expm1(-1 / lag2), mean3 = -lag3 * expm1(-1 / lag3);
        double from2 = -expm1(-1 / lag2) - (1 - mean2), from3 = -expm1(-1 / lag3) - (1 - mean3);
        double c1 = cos(t1), c2 = cos(t2), e1 = gap[3 * s], e2 = gap[3 * s + 1], e3 = gap[3 * s + 2];
        for (int k = 0; k <= steps; k++) {
            if (row[k] >= 0) {
                double *out = q + ((long)s * rows + row[k]) * 4;
                out[0] = phi, out[1] = t1, out[2] = t2, out[3] = t3;
                out = speed + ((long)s * rows + row[k]) * 2;
                out[0] = w1, out[1] = w2;
            }
            if (k == steps)
                break;
            /* servos */
            double r1 = p[0] * commands[2 * k], r2 = p[1] * commands[2 * k + 1];
            if (running[k])
                r1 += p[2], r2 += p[3];
            r1 = clip(r1, limit), r2 = clip(r2, limit);
            double gap1 = w1 - r1, gap2 = w2 - r2;
            double way1 = r1 * h + (gap1 - gap1 * decay) / bandwidth;
            double way2 = r2 * h + (gap2 - gap2 * decay) / bandwidth;
            double f1 = r1 + gap1 * decay, f2 = r2 + gap2 * decay;
            double n1 = w1 + clip(f1 - w1, most), n2 = w2 + clip(f2 - w2, most);
            if (fabs(n1 - f1) > 1e-12)
                way1 = (w1 + n1) * (h / 2);
            if (fabs(n2 - f2) > 1e-12)
                way2 = (w2 + n2) * (h / 2);
            /* contacts */
            double sign = n1 > 0 ? 1 : n1 < 0 ? -1 : 0;
            double ahead2 = (a2 - t2) * sign, ahead3 = (a3 - t3) * sign;
            double side1 = p[LATERAL] * sqrt(1 - c1 * c1), side2 = p[LATERAL] * sqrt(1 - c2 * c2);
            double at3 = k2 * s3 * (ahead3 - clip(ahead3, g3)), at2 = k2 * s2 * (ahead2 - clip(ahead2, g2));
            double mid3 = felt(at3, c2, side2, capacity), mid2 = felt(at2, c1, side1, capacity);
            double in3 = felt(mid3, c2, side2, capacity);
            double in2 = felt(mid2, c1, side1, capacity) + ratio * felt(in3, c2, side2, capacity);
            double stage2 = passed(in2, c1, side1, capacity, creep, per);
            double stage3 = passed(in3, c2, side2, capacity, creep, per);
            double branch2 = passed(mid2, c1, side1, capacity, creep, per)
                * passed(at2, c1, side1, capacity, creep, per);
            double branch3 = passed(mid3, c2, side2, capacity, creep, per)
                * passed(at3, c2, side2, capacity, creep, per);
            /* gearheads and joint 1 */
            double before = disk, part = 1;
            disk_axis += way1;
            disk = low(high(disk, disk_axis - p[9]), disk_axis + p[9]);
            if (way1 != 0)
                part = (disk - before) / way1;
            double u0 = w1 * part, u1 = n1 * part;
            a1 += way2;
            t1 = low(high(t1, a1 - p[10]), a1 + p[10]);
            w1 = n1, w2 = n2;
            /* joint 2 */
            double n = cos(t1), v0 = u0 * c1, v1 = u1 * n;
            v0 *= stage2, v1 *= stage2;
            a2 += k2 * branch2 * (h / 2) * (v0 * c1 * c1 + v1 * n * n);
            c1 = n;
            double moved = low(high(t2, a2 - rest2), a2 + rest2);
            t2 = t2 + from2 * d2 + (1 - mean2) * (moved - t2);
            d2 = low(high(t2, a2 - rest2), a2 + rest2) - t2;
            /* the last disk and joint 3 */
            phi += k_g * (h / 2) * (v0 + v1);
            n = cos(t2);
            v0 *= c2 * stage3, v1 *= n * stage3;
            a3 += k3 * branch3 * (h / 2) * (v0 * c2 * c2 + v1 * n * n);
            c2 = n;
            moved = low(high(t3, a3 - rest3), a3 + rest3);
            t3 = t3 + from3 * d3 + (1 - mean3) * (moved - t3);
            d3 = low(high(t3, a3 - rest3), a3 + rest3) - t3;
            const double *wanted = desired + 3 * (k + 1);
            e1 = high(e1, fabs(t1 - wanted[0]));
            e2 = high(e2, fabs(t2 - wanted[1]));
            e3 = high(e3, fabs(t3 - wanted[2]));
        }
        gap[3 * s] = e1, gap[3 * s + 1] = e2, gap[3 * s + 2] = e3;
    }
}
