/* The quasi-static manipulator of servos.py and disk_chain.py, one sample after
 * another. The Python modules explain the computation; the names here are theirs. Both give the
 * same numbers to within rounding (tests/machine/test_kernel.py).
 *
 * Plain C99 without Python: built as an optional extension, loaded by compiled.py through ctypes.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "layout.h"

#define MOST_TRIES 60
#define KEPT 8    /* number of step lengths whose factors are kept */
#define MOTORS 2
#define POINTS 3 /* largest number of points in a step */

static const double SPEED_TOLERANCE_RAD_S = 1e-12, TOUCH_TOLERANCE_RAD = 1e-9;
static const double LEAST_TORQUE_NM = 1e-30, LEAST_COSINE = 1e-9, MOST_SHARE = 0.99;
static const double SLIP_SPEED_RAD_S = 1e-3, RATE_TOLERANCE = 1e-12, LEAST_RATE = 1e-6;

/* Defined in dynamic.c. */
int planner_dynamic_march(int64_t m, int64_t rows, int64_t samples, double h, double lead,
                          double gamma, double k_g, const double *masses, const double *mean,
                          const double *swing, double *y, double *pieces, double *gained,
                          double *energy, double *slipping);

/* Factors that depend only on the length of a step: (2 x 4) of the servos, 2 for each joint from 2. */
typedef struct {
    double length;
    double servo[MOTORS][4];
    double *weight; /* (joints - 1, 2) */
} Factors;

/* Fractions that the contacts transmit: (joints - 1) each. Loads of the joints, and least and largest
 * lead of their axes at rest: (joints) each. */
typedef struct {
    double *cosine, *stage, *branch, *steady, *rising;
    double *load, *least, *most;
} Contacts;

INLINE double clip(double x, double most) { return x > most ? most : x < -most ? -most : x; }

INLINE double between(double x, double low, double high)
{
    double y = x > low ? x : low;
    return y < high ? y : high;
}

/* -- factors of a step's length ------------------------------------------------------------ */

/* Entries of exp([[0, 1], [-b^2, -2 z b]] h), for any damping. */
static void oscillator(double b, double z, double h, double *e)
{
    double d = z * z - 1, root = b * sqrt(fabs(d)), fade = exp(-z * b * h), cosh_, sinh_;
    if (root * h < 1e-6) {
        cosh_ = fade;
        sinh_ = h * fade;
    } else if (d < 0) {
        cosh_ = fade * cos(root * h);
        sinh_ = fade * sin(root * h) / root;
    } else {
        double slow = exp((root - z * b) * h), fast = exp((-root - z * b) * h);
        cosh_ = (slow + fast) / 2;
        sinh_ = (slow - fast) / (2 * root);
    }
    double spin = z * b * sinh_;
    e[0] = cosh_ + spin;
    e[1] = sinh_;
    e[2] = -(b * b) * sinh_;
    e[3] = cosh_ - spin;
}

static void weigh(double constant, double h, double *weight)
{
    double lag = constant / h;
    double mean = lag > 0 ? -lag * expm1(-1 / lag) : 0.0;
    double settled = lag > 0 ? -expm1(-1 / lag) : 1.0;
    weight[0] = settled - (1 - mean);
    weight[1] = 1 - mean;
}

static void factors(const Model *m, const Own *o, double h, Factors *f)
{
    double part = h / (double)(m->points - 1);
    int64_t last = m->joints - 2;
    f->length = h;
    for (int i = 0; i < MOTORS && m->lagging; i++) {
        if (m->second)
            oscillator(o->servo_bandwidth_rad_s[i], o->servo_damping[i], part, f->servo[i]);
        else
            f->servo[i][0] = exp(-o->servo_bandwidth_rad_s[i] * part);
    }
    for (int64_t j = 0; j <= last && m->lagged; j++)
        weigh(o->viscous_friction_nms_per_rad[j] / o->shaft_stiffness_nm_per_rad[j],
              j < last ? part : h, f->weight + 2 * j);
}

/* -- servos -------------------------------------------------------------------------------- */

INLINE double first_order(const Factors *f, int i, double b, double r0, double r1, double h,
                          double before, double *travel)
{
    double behind = r0 == r1 ? 0.0 : (r1 - r0) / (h * b), gap = before - r0 + behind, left = gap * f->servo[i][0];
    *travel = (r0 + r1) * (h / 2) - behind * h + (gap - left) / b;
    return r1 - behind + left;
}

INLINE double second_order(const Factors *f, int i, double b, double z, double r0, double r1,
                           double h, double before, double *slope, double *travel)
{
    const double *e = f->servo[i];
    double twice = 2 * z / b, rate = (r1 - r0) / h;
    double x = before - r0 + twice * rate, y = *slope - rate;
    double left = e[0] * x + e[1] * y, left_slope = e[2] * x + e[3] * y;
    *slope = left_slope + rate;
    *travel = (r0 + r1) * (h / 2) - twice * rate * h + (y - left_slope) / (b * b)
              + twice * (x - left);
    return r1 - twice * rate + left;
}

/* Advance motor i by h for a reference from r0 to r1; return the travel. */
INLINE double motor(const Model *m, const Own *o, const Held *x, const Factors *f, int i,
                    double r0, double r1, double h)
{
    double before = x->speed[i], b = o->servo_bandwidth_rad_s[i], travel, free_ = r1;
    if (!m->lagging)
        travel = (r0 + r1) * (h / 2);
    else if (m->second)
        free_ = second_order(f, i, b, o->servo_damping[i], r0, r1, h, before, x->slope + i, &travel);
    else
        free_ = first_order(f, i, b, r0, r1, h, before, &travel);
    double new_ = m->second && m->limited ? clip(free_, o->velocity_limit_rad_s[i]) : free_;
    if (m->ramped) {
        new_ = before + clip(new_ - before, o->acceleration_limit_rad_s2[i] * h);
        if (!m->lagging)
            travel -= (r0 - before) * fabs(r0 - before) / (2 * o->acceleration_limit_rad_s2[i]);
    }
    x->speed[i] = new_;
    if (fabs(new_ - free_) > SPEED_TOLERANCE_RAD_S) {
        if (m->second)
            x->slope[i] = (new_ - before) / h;
        travel = (before + new_) * (h / 2);
    }
    return travel;
}

/* Integrals from a step's start to each later point; see `integrals` of servos.py. */
INLINE void integrals(int64_t points, const double *f, double h, double *out)
{
    if (points == 2) {
        out[0] = (h / 2) * (f[0] + f[1]);
        return;
    }
    out[0] = (5 * h / 24) * f[0] + (8 * h / 24) * f[1] - (h / 24) * f[2];
    out[1] = (h / 6) * (f[0] + f[2]) + (4 * h / 6) * f[1];
}

/* Advance motor i by a step: its speed at the points, its travel to each later point. */
INLINE void servo(const Model *m, const Own *o, const Held *x, const Factors *f, int i,
                  const double *command, int64_t stride, int running, double h, double *speed,
                  double *travel)
{
    double r[POINTS];
    int64_t points = m->points;
    for (int64_t p = 0; p < points; p++) {
        r[p] = o->gain[i] * command[p * stride] + (running ? o->input_bias_rad_s[i] : 0.0);
        if (p == points / 2 && fabs(r[p]) > o->velocity_limit_rad_s[i])
            x->saturated[i] += h;
        r[p] = clip(r[p], o->velocity_limit_rad_s[i]);
    }
    if (!m->lagging && !m->ramped) {
        for (int64_t p = 0; p < points; p++)
            speed[p] = r[p];
        integrals(points, r, h, travel);
        return;
    }
    double part = h / (double)(points - 1), way = 0;
    speed[0] = x->speed[i];
    for (int64_t p = 0; p + 1 < points; p++) {
        way += motor(m, o, x, f, i, r[p], r[p + 1], part);
        travel[p] = way;
        speed[p + 1] = x->speed[i];
    }
}

/* -- friction contacts --------------------------------------------------------------------- */

/* `Grip` of contacts.py. */
typedef struct {
    double cosine, sideways, capacity, most;
} Grip;

INLINE Grip grip(double cosine, double lateral, double capacity)
{
    double c = fabs(cosine), straight = 1.0 - cosine * cosine;
    Grip g;
    g.cosine = c = c > LEAST_COSINE ? c : LEAST_COSINE;
    g.sideways = lateral > 0 && straight > 0 ? lateral * sqrt(straight) : 0.0;
    g.capacity = capacity;
    g.most = g.sideways > 0 ? capacity * c / sqrt(c * c + g.sideways * g.sideways) : capacity;
    return g;
}

INLINE double carried(const Grip *g, double load)
{
    double x = load < g->most ? load : g->most, least = -MOST_SHARE * g->capacity;
    return x > least ? x : least;
}

INLINE double hold(const Grip *g, double load)
{
    double left = g->capacity * g->capacity - load * load, root = left > 0 ? sqrt(left) : 0.0;
    return root > LEAST_TORQUE_NM ? root : LEAST_TORQUE_NM;
}

INLINE double driver_torque(const Grip *g, double load)
{
    double x = carried(g, load);
    return g->sideways > 0 ? x * g->cosine + g->sideways * hold(g, x) : x * g->cosine;
}

INLINE double part(const Grip *g, double load)
{
    if (load >= g->most)
        return 0.0;
    if (g->sideways == 0)
        return 1.0;
    double x = carried(g, load), left = 1.0 - g->sideways * x / (g->cosine * hold(g, x));
    return left > 0 ? left : 0.0;
}

/* Minus the derivative of `part` by the load, 1/(N m). */
INLINE double part_slope(const Grip *g, double load)
{
    double x = carried(g, load), left = hold(g, x);
    return x == load ? g->sideways * g->capacity * g->capacity / (g->cosine * left * left * left) : 0.0;
}

/* The three contacts of a joint without viscous friction, from the joint to the first disk. `load` is
 * that of the joint, then what it asks of the disk. Return 0 where a contact is near its limit;
 * elsewhere `most` is not needed and the contact's share and its driver's torque have one root. */
INLINE int carry(double cosine, double lateral, double capacity, double creep, double creep_per_nm,
                 double later, double *load, double *kept)
{
    double c = fabs(cosine), straight = 1.0 - cosine * cosine, x = *load;
    c = c > LEAST_COSINE ? c : LEAST_COSINE;
    double sideways = lateral > 0 && straight > 0 ? lateral * sqrt(straight) : 0.0;
    for (int place = 2; place >= 0; place--) {
        if (place == 0)
            x = x + later;
        if (!(fabs(x) < MOST_SHARE * capacity))
            return 0;
        double root = sqrt(capacity * capacity - x * x), rate = 1.0 - sideways * x / (c * root);
        if (!(rate > LEAST_RATE)) /* then x is below `most`, whatever the rounding */
            return 0;
        double left = 1.0 - creep - creep_per_nm * fabs(x);
        kept[place] = rate * (left > 0 ? left : 0.0);
        x = sideways > 0 ? x * c + sideways * root : x * c;
    }
    *load = x;
    return 1;
}

/* `_share` of contacts.py: return the fraction transmitted, and write the load to `load`. */
static double share(const Grip *g, double steady, double whole, double *load)
{
    double full = part(g, whole), low = 0.0, high = 1.0, rising = whole - steady;
    *load = whole;
    if (full >= 1)
        return full;
    if (part(g, steady) <= 0) { /* at any rate */
        *load = steady;
        return 0.0;
    }
    double rate = full;
    *load = steady + rising * rate;
    for (int i = 0; i < MOST_TRIES; i++) {
        double gap = part(g, *load) - rate, before = rate;
        if (gap == 0)
            break;
        if (gap > 0)
            low = rate;
        else
            high = rate;
        rate += gap / (1 + rising * part_slope(g, *load));
        if (!(rate > low && rate < high))
            rate = (low + high) / 2;
        *load = steady + rising * rate;
        if (fabs(rate - before) < RATE_TOLERANCE)
            break;
    }
    return rate;
}

/* Fractions transmitted under load; `speed` is that of the first disk. Return the number of the first
 * contact from motor 1 on that slips grossly, or -1. */
INLINE int64_t passed(const Model *m, const Own *o, const Held *x, double speed, Contacts *c)
{
    int64_t count = m->joints - 1, slipping = -1;
    double turning = speed > 0 ? 1.0 : speed < 0 ? -1.0 : 0.0, disk = fabs(speed);
    double later = 0.0, later_steady = 0.0;
    for (int64_t j = 0; j < count; j++) {
        if (c->cosine[j] < 0)
            turning = -turning;
        double ahead = (x->axis[j + 1] - x->theta[j + 1]) * turning;
        double against = o->coulomb_friction_nm[j] - c->load[j + 1] * turning;
        int touching = (ahead >= o->half_gap[j] - TOUCH_TOLERANCE_RAD || against < 0) && turning != 0;
        if (m->soft)
            c->steady[j] = o->shaft_stiffness_nm_per_rad[j] * (ahead - clip(ahead, o->half_gap[j]));
        else
            c->steady[j] = touching ? against : 0.0;
        if (m->damped) {
            double cosine = fabs(c->cosine[j]), rate = o->k[j] * cosine * cosine * cosine * disk;
            c->rising[j] = touching ? o->viscous_friction_nms_per_rad[j] * rate : 0.0;
            disk *= cosine;
        }
    }
    for (int64_t j = count - 1; j >= 0; j--) {
        double steady = o->k[0] * c->steady[j], whole = steady, kept[3];
        int light = !m->damped && carry(c->cosine[j], *o->lateral_friction, *o->friction_capacity_nm,
                                        *o->creep, *o->creep_per_nm, later, &whole, kept);
        if (light)
            steady = whole;
        else if (m->damped)
            whole = steady + o->k[0] * c->rising[j];
        Grip g = {0, 0, 0, 0};
        if (!light)
            g = grip(c->cosine[j], *o->lateral_friction, *o->friction_capacity_nm);
        for (int place = light ? -1 : 2; place >= 0; place--) {
            if (place == 0) {
                steady = steady + later_steady;
                whole = whole + later;
            }
            double load = whole, rate = m->damped ? share(&g, steady, whole, &load) : part(&g, load);
            if (rate <= 0 && fabs(speed) > SLIP_SPEED_RAD_S)
                slipping = 3 * j + place;
            double most = fabs(load) < g.capacity ? fabs(load) : g.capacity;
            double left = 1.0 - *o->creep - *o->creep_per_nm * most;
            kept[place] = rate * (left > 0 ? left : 0.0);
            whole = driver_torque(&g, load);
            steady = m->damped ? driver_torque(&g, steady) : whole;
        }
        c->stage[j] = kept[0];
        c->branch[j] = kept[1] * kept[2];
        if (j > 0) {
            later = o->k[j] / o->k[j - 1] * whole;
            later_steady = o->k[j] / o->k[j - 1] * steady;
        }
    }
    return slipping;
}

/* -- joints -------------------------------------------------------------------------------- */

/* The play operator: the lead of the axis stays between least and most. */
INLINE double taken(double theta, double axis, double least, double most)
{
    return between(theta, axis - most, axis - least);
}

/* See `rest_range` of disk_chain.py. */
INLINE void rest(const Contacts *c, int64_t i, double half_gap, double coulomb, double stiffness)
{
    double least = -coulomb - c->load[i], most = coulomb - c->load[i];
    c->least[i] = least / stiffness + (least > 0 ? half_gap : -half_gap);
    c->most[i] = most / stiffness + (most < 0 ? -half_gap : half_gap);
}

/* Load all joints with gravity at their present angles. */
INLINE void bear(const Model *m, const Own *o, const Held *x, const Contacts *c)
{
    double angle = 0, load = 0;
    for (int64_t i = 0; i < m->joints; i++) {
        angle += x->theta[i];
        c->load[i] = m->inclined ? o->weights[i] * cos(angle) : 0.0;
    }
    for (int64_t i = m->joints - 1; i >= 0; i--)
        c->load[i] = load -= c->load[i];
    rest(c, 0, o->gearhead_half[1], 0.0, INFINITY);
    for (int64_t j = 0; j < m->joints - 1; j++)
        rest(c, j + 1, o->half_gap[j], o->coulomb_friction_nm[j], o->shaft_stiffness_nm_per_rad[j]);
}

/* Turn the axis of joint i by `travel`; return the joint's angle. Joint 0 has only motor 2's gearhead. */
INLINE double turn(const Model *m, const Held *x, const Factors *f, const Contacts *c, int64_t i,
                   double travel)
{
    double axis = x->axis[i] += travel, least = c->least[i], most = c->most[i];
    if (i == 0)
        return x->theta[0] = m->geared_2 ? taken(x->theta[0], axis, least, most) : axis;
    int64_t j = i - 1;
    double moved = taken(x->theta[i], axis, least, most);
    if (m->lagged) {
        const double *weight = f->weight + 2 * j;
        double now = x->theta[i] + weight[0] * x->wound[i] + weight[1] * (moved - x->theta[i]);
        x->wound[i] = taken(now, axis, least, most) - now;
        moved = now;
    }
    return x->theta[i] = moved;
}

/* Reduce the speed of the first disk at the points, in place, by the gearhead's play. */
INLINE void geared(const Model *m, const Own *o, const Held *x, double *speed, double travel)
{
    if (!m->geared_1)
        return;
    double before = x->disk[0];
    x->disk[1] += travel;
    x->disk[0] = taken(before, x->disk[1], -o->gearhead_half[0], o->gearhead_half[0]);
    if (travel == 0)
        return;
    double turned = (x->disk[0] - before) / travel;
    for (int64_t p = 0; p < m->points; p++)
        speed[p] *= turned;
}

/* One step of the chain under motor speeds and travels; return the contact that slips grossly, or -1. */
INLINE int64_t chain(const Model *m, const Own *o, const Held *x, const Factors *f, double h,
                  double *disk, double disk_travel, double *ways, Contacts *c)
{
    int64_t points = m->points, last = m->joints - 2;
    int passing = m->creeping || m->loaded;
    if (m->inclined)
        bear(m, o, x, c);
    geared(m, o, x, disk, disk_travel);
    int64_t slipping = m->loaded ? passed(m, o, x, disk[points - 1], c) : -1;
    for (int64_t j = 0; j <= last; j++) {
        double cosine[POINTS], driven[POINTS], gain = o->k[j];
        cosine[0] = c->cosine[j];
        cosine[1] = cos(turn(m, x, f, c, j, ways[0]));
        if (points > 2)
            cosine[2] = cos(turn(m, x, f, c, j, ways[1] - ways[0]));
        c->cosine[j] = cosine[points - 1];
        if (j == last) {
            double way[POINTS - 1];
            integrals(points, disk, h, way);
            *x->first += m->k_g * way[points - 2];
        }
        if (passing)
            gain *= c->branch[j];
        for (int64_t p = 0; p < points; p++) {
            disk[p] *= cosine[p];
            if (passing)
                disk[p] *= c->stage[j];
            driven[p] = disk[p] * cosine[p] * cosine[p];
        }
        integrals(points, driven, h, ways);
        for (int64_t p = 0; p + 1 < points; p++)
            ways[p] *= gain;
    }
    turn(m, x, f, c, last + 1, ways[points - 2]);
    return slipping;
}

/* -- with inertia -------------------------------------------------------------------------- */

/* One step of the dynamic manipulator; its motors follow the servos' speeds. */
INLINE int64_t dynamic(const Model *m, const Held *x, int64_t sample, double h,
                       double speed[MOTORS][POINTS], double ways[MOTORS][POINTS - 1])
{
    Moving y = moving(m, sample);
    int64_t points = m->points;
    double mean[MOTORS], swing[MOTORS];
    for (int i = 0; i < MOTORS; i++) {
        mean[i] = ways[i][points - 2] / h;
        swing[i] = speed[i][points - 1] - speed[i][0];
    }
    double lead = h < *y.last ? h / *y.last / 2 : 0.5;
    *y.last = h;
    planner_dynamic_march(m->joints - 1, m->dynamic, 1, h, lead, m->gamma, m->k_g,
                          m->masses + sample * m->heavy, mean, swing, y.y, y.pieces, y.gained,
                          y.energy, y.slipping);
    for (int i = 0; i < MOTORS; i++)
        x->saturated[i] += y.pieces[i] != 0 ? h : 0.0;
    *x->first = y.y[m->coordinates];
    for (int64_t i = 0; i < m->joints; i++)
        x->theta[i] = y.y[m->coordinates + 1 + i];
    return (int64_t)*y.slipping;
}

/* -- the loop ------------------------------------------------------------------------------ */

INLINE void record(const Model *m, const Held *x, int64_t sample, int64_t k, const double *speed)
{
    int64_t row = m->row[k], size = m->joints + 1;
    if (row < 0)
        return;
    double *q = m->q + (sample * m->rows + row) * size;
    double *rates = m->speed + (sample * m->rows + row) * MOTORS;
    q[0] = *x->first;
    for (int64_t i = 1; i < size; i++)
        q[i] = x->theta[i - 1];
    rates[0] = speed[0];
    rates[1] = speed[1];
}

INLINE void run(const Model *m, const Commands *u, int64_t sample, int64_t first, int64_t last,
                Factors *kept_, Contacts *c)
{
    Own o = own(m, sample);
    Held x = held(m, sample);
    int64_t points = m->points;
    for (int i = 0; i < KEPT; i++)
        kept_[i].length = -1;
    for (int64_t j = 0; j < m->joints - 1; j++) {
        c->cosine[j] = cos(x.theta[j]);
        c->stage[j] = 1 - *o.creep;
        c->branch[j] = c->stage[j] * c->stage[j];
    }
    bear(m, &o, &x, c);
    int slot = 0;
    for (int64_t k = first; k < last; k++) {
        double h = m->length[k], speed[MOTORS][POINTS], ways[MOTORS][POINTS - 1];
        const double *command = u->value + (k - first) * u->step + sample * u->sample;
        if (kept_[slot].length != h) {
            for (slot = 0; slot < KEPT - 1 && kept_[slot].length >= 0; slot++)
                if (kept_[slot].length == h)
                    break;
            if (kept_[slot].length != h)
                factors(m, &o, h, kept_ + slot);
        }
        for (int i = 0; i < MOTORS; i++)
            servo(m, &o, &x, kept_ + slot, i, command + i * u->motor, u->point, m->running[k], h,
                  speed[i], ways[i]);
        double begins[MOTORS] = {speed[0][0], speed[1][0]};
        double ends[MOTORS] = {speed[0][points - 1], speed[1][points - 1]};
        const double *motors = m->dynamic ? moving(m, sample).y : NULL;
        record(m, &x, sample, k, motors ? motors : begins);
        int64_t slipping = motors ? dynamic(m, &x, sample, h, speed, ways)
                                  : chain(m, &o, &x, kept_ + slot, h, speed[0],
                                          ways[0][points - 2], ways[1], c);
        if (slipping >= 0) {
            if (x.slip[1] < 0) {
                x.slip[1] = (double)k;
                x.slip[2] = (double)slipping;
            }
            x.slip[0] += h;
        }
        for (int64_t i = 0; i < m->joints; i++) {
            double gap = fabs(x.theta[i] - m->desired[(k + 1) * m->joints + i]);
            x.gap[i] = gap > x.gap[i] ? gap : x.gap[i];
        }
        if (k + 1 == m->steps)
            record(m, &x, sample, m->steps, motors ? motors : ends);
    }
}

EXPORT int64_t planner_kernel_version(void) { return VERSION; }

/* Checksum of kernel.c, dynamic.c and layout.h by setup.py: an old kernel may have the same layout. */
EXPORT int64_t planner_kernel_source(void) { return SOURCE; }

/* For the paper's arm under held commands: with constant counts the compiler unrolls the loops. */
static void run_three(const Model *m, const Commands *u, int64_t sample, int64_t first,
                      int64_t last, Factors *kept_, Contacts *c)
{
    Model known = *m;
    known.joints = 3;
    known.points = 2;
    run(&known, u, sample, first, last, kept_, c);
}

static void run_any(const Model *m, const Commands *u, int64_t sample, int64_t first, int64_t last,
                    Factors *kept_, Contacts *c)
{
    run(m, u, sample, first, last, kept_, c);
}

/* Advance samples begin ... end - 1 by the steps first ... last - 1; return -1 if out of memory. */
EXPORT int planner_advance(const Model *m, const Commands *u, int64_t begin, int64_t end,
                           int64_t first, int64_t last)
{
    int64_t n = m->joints - 1;
    double *room = malloc((size_t)(8 * n + 3 + KEPT * 2 * n) * sizeof(double));
    if (room == NULL)
        return -1;
    double *loads = room + 5 * n;
    Contacts c = {room, room + n, room + 2 * n, room + 3 * n, room + 4 * n,
                  loads, loads + n + 1, loads + 2 * (n + 1)};
    Factors kept_[KEPT];
    for (int i = 0; i < KEPT; i++)
        kept_[i].weight = loads + 3 * (n + 1) + i * 2 * n;
    int three = m->joints == 3 && m->points == 2;
    for (int64_t sample = begin; sample < end; sample++)
        (three ? run_three : run_any)(m, u, sample, first, last, kept_, &c);
    free(room);
    return 0;
}
