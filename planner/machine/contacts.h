/* Friction contacts under load, as in friction/contacts.py, over W machines at once. Where a contact
 * of any of them is near its limit all W take the exact way one by one: the same bits, slower. */

#include "lanes.h"

#define MOST_TRIES 60

static const double TOUCH_TOLERANCE_RAD = 1e-9, LEAST_TORQUE_NM = 1e-30, LEAST_COSINE = 1e-9;
static const double MOST_SHARE = 0.99, SLIP_SPEED_RAD_S = 1e-3, RATE_TOLERANCE = 1e-12;
static const double LEAST_RATE = 1e-6;

/* Fractions that the contacts transmit, and what follows from K: (joints - 1) each. Loads of the
 * joints, and least and largest lead of their axes at rest: (joints) each. */
typedef struct {
    double *cosine, *stage, *branch, *steady, *rising, *ratio;
    double *load, *least, *most;
} Contacts;

/* -- near the limit, one machine ----------------------------------------------------------- */

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

/* The three contacts of joint j for machine l, from the joint to the first disk: the fractions that
 * they keep. `steady` and `whole` are the joint's loads, then what it asks of the disk; `later` and
 * `later_steady` come from the joints behind. */
static void carry_exactly(const Model *m, const Own *o, const Contacts *c, int64_t j, int l,
                          double speed, double later, double later_steady, double *steady,
                          double *whole, double *slipping)
{
    Grip g = grip(ROW(c->cosine, j)[l], o->lateral_friction[l], o->friction_capacity_nm[l]);
    double kept[3];
    for (int place = 2; place >= 0; place--) {
        if (place == 0) {
            *steady = *steady + later_steady;
            *whole = *whole + later;
        }
        double load = *whole, rate = m->damped ? share(&g, *steady, *whole, &load) : part(&g, load);
        if (rate <= 0 && fabs(speed) > SLIP_SPEED_RAD_S)
            *slipping = (double)(3 * j + place);
        double most = fabs(load) < g.capacity ? fabs(load) : g.capacity;
        double left = 1.0 - o->creep[l] - o->creep_per_nm[l] * most;
        kept[place] = rate * (left > 0 ? left : 0.0);
        *whole = driver_torque(&g, load);
        *steady = m->damped ? driver_torque(&g, *steady) : *whole;
    }
    ROW(c->stage, j)[l] = kept[0];
    ROW(c->branch, j)[l] = kept[1] * kept[2];
}

/* -- far from it, W machines --------------------------------------------------------------- */

/* One contact: the fraction that it keeps, and the load of its driver in place of its own. `near` is
 * above 0 where the contact is near its limit; elsewhere its share and its driver's torque have one
 * root, and no other of the grip's numbers is needed. */
typedef struct {
    double cosine, sideways, capacity, creep, creep_per_nm;
} Wheel;

INLINE double keep(const Wheel *w, double *load, double *near)
{
    double x = *load, root = sqrt(w->capacity * w->capacity - x * x);
    double rate = 1.0 - w->sideways * x / (w->cosine * root);
    double left = 1.0 - w->creep - w->creep_per_nm * fabs(x);
    int far = (fabs(x) < MOST_SHARE * w->capacity) & (rate > LEAST_RATE); /* false for no number */
    *near += far ? 0.0 : 1.0;
    *load = x * w->cosine + w->sideways * root;
    return rate * (left > 0 ? left : 0.0);
}

/* The three contacts of joint j without viscous friction; `load` as `whole` above. Return 0 where
 * one is near its limit; `load` and the fractions are then of no use. */
INLINE int carry(const Own *o, const Contacts *c, int64_t j, const double *later, double *load)
{
    const double *cosine = ROW(c->cosine, j);
    double *stage = ROW(c->stage, j), *branch = ROW(c->branch, j);
    Lane near;
    LANES {
        double across = fabs(cosine[l]), straight = 1.0 - cosine[l] * cosine[l], x = load[l];
        double root = sqrt(straight > 0 ? straight : 0.0), lateral = o->lateral_friction[l];
        Wheel w = {across > LEAST_COSINE ? across : LEAST_COSINE, (lateral > 0 ? lateral : 0.0) * root,
                   o->friction_capacity_nm[l], o->creep[l], o->creep_per_nm[l]};
        near[l] = 0.0;
        double third = keep(&w, &x, near + l), second = keep(&w, &x, near + l);
        x = x + later[l];
        stage[l] = keep(&w, &x, near + l);
        branch[l] = second * third;
        load[l] = x;
    }
    int64_t any = 0, bits[W]; /* of 0.0: none; sums of doubles would keep their order */
    memcpy(bits, near, sizeof(Lane));
    for (int l = 0; l < W; l++)
        any |= bits[l];
    return any == 0;
}

/* Fractions transmitted under load; `speed` is that of the first disk. `slipping` becomes the number
 * of the first contact from motor 1 on that slips grossly, or -1. */
INLINE void passed(const Model *m, const Own *o, const Held *x, const double *speed, Contacts *c,
                   double *slipping)
{
    int64_t count = m->joints - 1;
    Lane turning, disk, later = {0}, later_steady = {0};
    LANES {
        turning[l] = speed[l] > 0 ? 1.0 : speed[l] < 0 ? -1.0 : 0.0;
        disk[l] = fabs(speed[l]);
        slipping[l] = -1;
    }
    for (int64_t j = 0; j < count; j++) {
        const double *cosine = ROW(c->cosine, j), *half = ROW(o->half_gap, j);
        const double *stiffness = ROW(o->shaft_stiffness_nm_per_rad, j), *k = ROW(o->k, j);
        const double *axis = ROW(x->axis, j + 1), *theta = ROW(x->theta, j + 1);
        const double *coulomb = ROW(o->coulomb_friction_nm, j), *load = ROW(c->load, j + 1);
        const double *viscous = ROW(o->viscous_friction_nms_per_rad, j);
        double *steady = ROW(c->steady, j), *rising = ROW(c->rising, j);
        LANES turning[l] = cosine[l] < 0 ? -turning[l] : turning[l];
        if (m->soft)
            LANES {
                double ahead = (axis[l] - theta[l]) * turning[l];
                steady[l] = stiffness[l] * (ahead - clip(ahead, half[l]));
            }
        else
            LANES {
                double ahead = (axis[l] - theta[l]) * turning[l];
                double against = coulomb[l] - load[l] * turning[l], across = fabs(cosine[l]);
                double rate = k[l] * across * across * across * disk[l];
                int touching = ((ahead >= half[l] - TOUCH_TOLERANCE_RAD) | (against < 0))
                               & (turning[l] != 0);
                steady[l] = touching ? against : 0.0;
                rising[l] = touching ? viscous[l] * rate : 0.0;
                disk[l] *= across;
            }
    }
    for (int64_t j = count - 1; j >= 0; j--) {
        const double *given = ROW(c->steady, j), *rising = ROW(c->rising, j), *k = ROW(o->k, 0);
        const double *ratio = ROW(c->ratio, j);
        Lane steady, whole;
        LANES whole[l] = steady[l] = k[l] * given[l];
        if (!m->damped && carry(o, c, j, later, whole))
            memcpy(steady, whole, sizeof(Lane));
        else
            for (int l = 0; l < W; l++) {
                whole[l] = m->damped ? steady[l] + k[l] * rising[l] : steady[l];
                carry_exactly(m, o, c, j, l, speed[l], later[l], later_steady[l], steady + l, whole + l,
                              slipping + l);
            }
        LANES {
            later[l] = ratio[l] * whole[l];
            later_steady[l] = ratio[l] * steady[l];
        }
    }
}
