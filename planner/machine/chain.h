/* The disk chain of disk_chain.py and the loop over the steps, for W machines at once. */

#include "contacts.h"

/* Defined in dynamic.c. */
int planner_dynamic_march(int64_t m, int64_t rows, int64_t samples, double h, double lead,
                          double gamma, double k_g, const double *masses, const double *mean,
                          const double *swing, double *y, double *pieces, double *gained,
                          double *energy, double *slipping);

/* -- joints -------------------------------------------------------------------------------- */

/* The play operator: the lead of the axis stays between least and most. */
INLINE double taken(double theta, double axis, double least, double most)
{
    return between(theta, axis - most, axis - least);
}

/* See `rest_range` of disk_chain.py. */
INLINE void rest(const Contacts *c, int64_t i, int l, double half_gap, double coulomb,
                 double stiffness)
{
    double load = ROW(c->load, i)[l], least = -coulomb - load, most = coulomb - load;
    ROW(c->least, i)[l] = least / stiffness + (least > 0 ? half_gap : -half_gap);
    ROW(c->most, i)[l] = most / stiffness + (most < 0 ? -half_gap : half_gap);
}

/* Load all joints with gravity at their present angles. */
INLINE void bear(const Model *m, const Own *o, const Held *x, const Contacts *c)
{
    Lane angle = {0}, load = {0}, cosine = {0};
    for (int64_t i = 0; i < m->joints; i++) {
        const double *theta = ROW(x->theta, i), *weight = ROW(o->weights, i);
        double *own_ = ROW(c->load, i);
        LANES angle[l] += theta[l];
        if (m->inclined)
            cosines(angle, cosine);
        LANES own_[l] = m->inclined ? weight[l] * cosine[l] : 0.0;
    }
    for (int64_t i = m->joints - 1; i >= 0; i--) {
        double *own_ = ROW(c->load, i);
        LANES own_[l] = load[l] -= own_[l];
    }
    for (int l = 0; l < W; l++) {
        rest(c, 0, l, ROW(o->gearhead_half, 1)[l], 0.0, INFINITY);
        for (int64_t j = 0; j < m->joints - 1; j++)
            rest(c, j + 1, l, ROW(o->half_gap, j)[l], ROW(o->coulomb_friction_nm, j)[l],
                 ROW(o->shaft_stiffness_nm_per_rad, j)[l]);
    }
}

/* Turn the axis of joint i by `travel`, and the joint with it. Joint 0 has only motor 2's gearhead. */
INLINE void turn(const Model *m, const Held *x, const Factors *f, const Contacts *c, int64_t i,
                 const double *travel)
{
    double *axis = ROW(x->axis, i), *theta = ROW(x->theta, i), *wound = ROW(x->wound, i);
    const double *least = ROW(c->least, i), *most = ROW(c->most, i);
    LANES axis[l] += travel[l];
    if (i == 0 && !m->geared_2)
        memcpy(theta, axis, sizeof(Lane));
    else if (i == 0 || !m->lagged)
        LANES theta[l] = taken(theta[l], axis[l], least[l], most[l]);
    else {
        const double *by_wound = ROW(f->weight, 2 * i - 2), *by_moved = ROW(f->weight, 2 * i - 1);
        LANES {
            double moved = taken(theta[l], axis[l], least[l], most[l]);
            double now = theta[l] + by_wound[l] * wound[l] + by_moved[l] * (moved - theta[l]);
            wound[l] = taken(now, axis[l], least[l], most[l]) - now;
            theta[l] = now;
        }
    }
}

/* Reduce the speed of the first disk at the points, in place, by the gearhead's play. */
INLINE void geared(const Model *m, const Own *o, const Held *x, Lane *speed, const double *travel)
{
    double *disk = ROW(x->disk, 0), *axis = ROW(x->disk, 1);
    const double *half = ROW(o->gearhead_half, 0);
    Lane turned;
    if (!m->geared_1)
        return;
    LANES {
        double before = disk[l];
        axis[l] += travel[l];
        disk[l] = taken(before, axis[l], -half[l], half[l]);
        turned[l] = (disk[l] - before) / (travel[l] == 0 ? 1.0 : travel[l]);
        turned[l] = travel[l] == 0 ? 1.0 : turned[l];
    }
    for (int64_t p = 0; p < m->points; p++)
        LANES speed[p][l] *= turned[l];
}

/* One step of the chain under motor speeds and travels; `slipping` as in `passed`. */
INLINE void chain(const Model *m, const Own *o, const Held *x, const Factors *f, double h, Lane *disk,
                  const double *disk_travel, Lane *ways, Contacts *c, double *slipping)
{
    int64_t points = m->points, last = m->joints - 2;
    int passing = m->creeping || m->loaded;
    if (m->inclined)
        bear(m, o, x, c);
    geared(m, o, x, disk, disk_travel);
    if (m->loaded)
        passed(m, o, x, disk[points - 1], c, slipping);
    else
        LANES slipping[l] = -1;
    for (int64_t j = 0; j <= last; j++) {
        const double *stage = ROW(c->stage, j), *branch = ROW(c->branch, j), *k = ROW(o->k, j);
        Lane cosine[POINTS], driven[POINTS], way[POINTS - 1];
        memcpy(cosine[0], ROW(c->cosine, j), sizeof(Lane));
        turn(m, x, f, c, j, ways[0]);
        cosines(ROW(x->theta, j), cosine[1]);
        if (points > 2) {
            LANES ways[1][l] -= ways[0][l];
            turn(m, x, f, c, j, ways[1]);
            cosines(ROW(x->theta, j), cosine[2]);
        }
        memcpy(ROW(c->cosine, j), cosine[points - 1], sizeof(Lane));
        if (j == last) {
            integrals(points, (const Lane *)disk, h, way);
            LANES x->first[l] += m->k_g * way[points - 2][l];
        }
        for (int64_t p = 0; p < points; p++) {
            LANES disk[p][l] *= cosine[p][l];
            if (passing)
                LANES disk[p][l] *= stage[l];
            LANES driven[p][l] = disk[p][l] * cosine[p][l] * cosine[p][l];
        }
        integrals(points, (const Lane *)driven, h, ways);
        for (int64_t p = 0; p + 1 < points; p++)
            if (passing)
                LANES ways[p][l] *= k[l] * branch[l];
            else
                LANES ways[p][l] *= k[l];
    }
    turn(m, x, f, c, last + 1, ways[points - 2]);
}

/* -- with inertia: one machine at a time --------------------------------------------------- */

/* One step of the dynamic manipulator; its motors follow the servos' speeds. Return the contact that
 * slips grossly, or -1. */
INLINE double dynamic(const Model *m, const Held *x, int64_t sample, double h,
                      Lane speed[MOTORS][POINTS], Lane ways[MOTORS][POINTS - 1])
{
    int64_t points = m->points, passive = m->joints - 1;
    Moving y = moving(m->moving + sample * moving_count(passive), passive, 1);
    double mean[MOTORS], swing[MOTORS];
    for (int i = 0; i < MOTORS; i++) {
        mean[i] = *ways[i][points - 2] / h;
        swing[i] = *speed[i][points - 1] - *speed[i][0];
    }
    double lead = h < *y.last ? h / *y.last / 2 : 0.5;
    *y.last = h;
    planner_dynamic_march(passive, m->dynamic, 1, h, lead, m->gamma, m->k_g,
                          m->masses + sample * m->heavy, mean, swing, y.y, y.pieces, y.gained,
                          y.energy, y.slipping);
    for (int i = 0; i < MOTORS; i++) {
        x->saturated[i] += y.pieces[i] != 0 ? h : 0.0;
        *speed[i][points - 1] = y.y[i];
    }
    *x->first = y.y[m->coordinates];
    for (int64_t i = 0; i < m->joints; i++)
        x->theta[i] = y.y[m->coordinates + 1 + i];
    return *y.slipping;
}

/* -- the loop ------------------------------------------------------------------------------ */

/* The machines of one group: samples `sample` ... `sample + mine - 1`, in as many lanes. */
typedef struct {
    int64_t sample, mine;
    Own own;
    Held held;
} Group;

INLINE void record(const Model *m, const Group *g, int64_t k, const double *speed_1,
                   const double *speed_2)
{
    int64_t row = m->row[k], size = m->joints + 1;
    for (int64_t l = 0; l < g->mine && row >= 0; l++) {
        int64_t at = (g->sample + l) * m->rows + row;
        double *q = m->q + at * size, *rates = m->speed + at * MOTORS;
        q[0] = g->held.first[l];
        for (int64_t i = 1; i < size; i++)
            q[i] = ROW(g->held.theta, i - 1)[l];
        rates[0] = speed_1[l];
        rates[1] = speed_2[l];
    }
}

/* Count the time of gross slip, and where and when it began; keep the largest deviations. */
INLINE void judge(const Model *m, const Held *x, int64_t k, double h, const double *slipping)
{
    double *time = ROW(x->slip, 0), *begin = ROW(x->slip, 1), *contact = ROW(x->slip, 2);
    LANES {
        int begins = (slipping[l] >= 0) & (begin[l] < 0);
        begin[l] = begins ? (double)k : begin[l];
        contact[l] = begins ? slipping[l] : contact[l];
        time[l] += slipping[l] >= 0 ? h : 0.0;
    }
    for (int64_t i = 0; i < m->joints; i++) {
        const double *theta = ROW(x->theta, i), desired = m->desired[(k + 1) * m->joints + i];
        double *gap = ROW(x->gap, i);
        LANES {
            double now = fabs(theta[l] - desired);
            gap[l] = now > gap[l] ? now : gap[l];
        }
    }
}

INLINE void run(const Model *m, const Commands *u, const Group *g, int64_t first, int64_t last,
                Factors *kept, Contacts *c)
{
    const Own *o = &g->own;
    const Held *x = &g->held;
    int64_t points = m->points;
    int slot = 0;
    for (int i = 0; i < KEPT; i++)
        kept[i].length = -1;
    for (int64_t j = 0; j < m->joints - 1; j++) {
        double *stage = ROW(c->stage, j), *branch = ROW(c->branch, j), *ratio = ROW(c->ratio, j);
        const double *k = ROW(o->k, j), *before = ROW(o->k, j > 0 ? j - 1 : 0);
        cosines(ROW(x->theta, j), ROW(c->cosine, j));
        LANES {
            stage[l] = 1 - o->creep[l];
            branch[l] = stage[l] * stage[l];
            ratio[l] = k[l] / before[l];
        }
    }
    bear(m, o, x, c);
    for (int64_t k = first; k < last; k++) {
        double h = m->length[k];
        Lane speed[MOTORS][POINTS], ways[MOTORS][POINTS - 1], slipping;
        const double *command = u->value + (k - first) * u->step + g->sample * u->sample;
        if (kept[slot].length != h) {
            for (slot = 0; slot < KEPT - 1 && kept[slot].length >= 0; slot++)
                if (kept[slot].length == h)
                    break;
            if (kept[slot].length != h)
                factors(m, o, h, kept + slot);
        }
        for (int i = 0; i < MOTORS; i++)
            servo(m, o, x, kept + slot, i, u, command + i * u->motor, g->mine, m->running[k], h,
                  speed[i], ways[i]);
        if (W == 1 && m->dynamic) {
            const double *motors = m->moving + g->sample * moving_count(m->joints - 1);
            record(m, g, k, motors, motors + 1);
            *slipping = dynamic(m, x, g->sample, h, speed, ways);
        } else {
            Lane end;
            record(m, g, k, speed[0][0], speed[1][0]);
            memcpy(end, speed[0][points - 1], sizeof(Lane));
            chain(m, o, x, kept + slot, h, speed[0], ways[0][points - 2], ways[1], c, slipping);
            memcpy(speed[0][points - 1], end, sizeof(Lane));
        }
        judge(m, x, k, h, slipping);
        if (k + 1 == m->steps)
            record(m, g, m->steps, speed[0][points - 1], speed[1][points - 1]);
    }
}

/* For the paper's arm under held commands: with constant counts the compiler unrolls the loops. */
CLONES static void run_three(const Model *m, const Commands *u, const Group *g, int64_t first,
                             int64_t last, Factors *kept, Contacts *c)
{
    Model known = *m;
    known.joints = 3;
    known.points = 2;
    run(&known, u, g, first, last, kept, c);
}

CLONES static void run_any(const Model *m, const Commands *u, const Group *g, int64_t first,
                           int64_t last, Factors *kept, Contacts *c)
{
    run(m, u, g, first, last, kept, c);
}

/* Advance samples begin ... end - 1, W at a time, by the steps first ... last - 1; return -1 if out
 * of memory. */
int ADVANCE(const Model *m, const Commands *u, int64_t begin, int64_t end, int64_t first, int64_t last)
{
    int64_t n = m->joints - 1, given = own_count(n), state = held_count(n);
    Factors kept[KEPT];
    double *room = malloc((size_t)(9 * n + 3 + KEPT * 2 * n + given + state) * sizeof(Lane));
    if (room == NULL)
        return -1;
    Contacts c = {room, ROW(room, n), ROW(room, 2 * n), ROW(room, 3 * n), ROW(room, 4 * n),
                  ROW(room, 5 * n), ROW(room, 6 * n), ROW(room, 7 * n + 1), ROW(room, 8 * n + 2)};
    for (int64_t i = 0; i < KEPT; i++)
        kept[i].weight = ROW(room, 9 * n + 3 + i * 2 * n);
    double *parameters = ROW(room, 9 * n + 3 + KEPT * 2 * n), *now = ROW(parameters, given);
    for (int64_t sample = begin; sample < end; sample += W) {
        int64_t mine = end - sample < W ? end - sample : W;
        Group g = {sample, mine, own(parameters, n, W), held(now, n, W)};
        for (int64_t l = 0; l < W; l++) {
            int64_t s = sample + (l < mine ? l : mine - 1);
            for (int64_t i = 0; i < given; i++)
                ROW(parameters, i)[l] = m->parameters[s * given + i];
            for (int64_t i = 0; i < state; i++)
                ROW(now, i)[l] = m->state[s * state + i];
        }
        (W == 1 && m->joints == 3 && m->points == 2 ? run_three : run_any)(m, u, &g, first, last, kept, &c);
        for (int64_t l = 0; l < mine; l++)
            for (int64_t i = 0; i < state; i++)
                m->state[(sample + l) * state + i] = ROW(now, i)[l];
    }
    free(room);
    return 0;
}
