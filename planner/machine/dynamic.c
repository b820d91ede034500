/* One step of the dynamic manipulator, as `March.step` of march.py and `StageLaws` of bodies.py
 * compute it, one sample after another. These explain the computation; the names here are theirs.
 * Arrays of Python are (rows, samples), so the rows of a sample are `samples` numbers apart.
 *
 * Plain C99 without Python, part of the same library as kernel.c.
 */

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "functions.h"

static const double LEAST_DRAG = 1e-6, LEAST_COSINE = 1e-9, LEAST_TORQUE_NM = 1e-30;
static const double MOST_SHARE = 0.99, SLIP_SPEED_RAD_S = 1e-3, STICTION_SLOPE = 1e8, EDGE_NM = 1e-8, EDGE_RAD = 1e-16;
static const int FULL_PASSES = 12, MOST_PASSES = 100, HALVINGS = 40;
static const double NEAR_END = 1e-6;

#ifdef _MSC_VER
#define NOINLINE __declspec(noinline)
#else
#define NOINLINE __attribute__((noinline))
#endif

#define LINKS (1 + JOINTS)
#define SIDES (1 + LINKS)

/* Mass matrices and matrices derived from them are n x n for n links, row after row; coupled: whether
 * they are not diagonal. */
typedef struct {
    double first[JOINTS], second[JOINTS], slope[2 * JOINTS], limit[2 * JOINTS];
    double drag[1 + JOINTS];
    double pull[LINKS], mass[LINKS * LINKS];
    int coupled;
} Gears;

typedef struct {
    double h, drag[BODIES], push[BODIES], reference[2], first[JOINTS], second[JOINTS];
    double coupling[LINKS * LINKS];
    int coupled;
    double offset[LIMITED], slope[LIMITED], limit[LIMITED];
    double ahead[PLAYS], stiff[PLAYS], half_gap[PLAYS];
} Stage;

INLINE double clip(double x, double most) { return x > most ? most : x < -most ? -most : x; }
INLINE double larger(double a, double b) { return a > b ? a : b; }
INLINE int driver(const Rows *r, int j) { return j ? r->stages + j - 1 : r->disk; }

/* -- the laws ------------------------------------------------------------------------------ */

INLINE void relative(const Rows *r, const Stage *s, const double *v, const double *reference,
                     double *w)
{
    int m = r->m;
    for (int i = 0; i < 2; i++)
        w[i] = reference[i] - v[i];
    for (int j = 0; j < m; j++) {
        w[2 + j] = s->first[j] * v[driver(r, j)] - v[r->stages + j];
        w[2 + m + j] = s->second[j] * v[r->stages + j] - v[r->axes + j];
    }
    for (int i = 0; i <= m; i++) {
        w[2 + 2 * m + i] = v[r->links + i];
        w[3 + 3 * m + i] = v[driver(r, i)];
    }
    for (int i = 0; i < r->plays; i++)
        w[r->limited + i] = v[i] - v[r->disk + i];
}

INLINE void torques(const Rows *r, const Stage *s, const double *w, double *torque)
{
    for (int i = 0; i < r->limited; i++)
        torque[i] = clip(s->offset[i] + s->slope[i] * w[i], s->limit[i]);
    for (int i = 0; i < r->plays; i++) {
        double ahead = s->ahead[i] + s->h * w[r->limited + i];
        torque[r->limited + i] = s->stiff[i] * (ahead - clip(ahead, s->half_gap[i]));
    }
}

/* The piece of one law at a value; `before` if that is valid within rounding. */
INLINE double piece(double value, double edge, double room, double before, int limited)
{
    int inside = fabs(value) <= edge + room;
    if (before == 0 ? inside : before * value >= edge - room)
        return before;
    if (inside)
        return 0.0;
    double now = value > 0 ? 1.0 : -1.0;
    return limited && before * now < 0 ? 0.0 : now;
}

/* Compute the pieces at these speeds; return whether any changed. */
INLINE int pieces_at(const Rows *r, const Stage *s, const double *v, double *pieces)
{
    double w[LAWS];
    int changed = 0;
    relative(r, s, v, s->reference, w);
    for (int i = 0; i < r->limited + r->plays; i++) {
        int l = i - r->limited;
        double now;
        if (l < 0)
            now = piece(s->offset[i] + s->slope[i] * w[i], s->limit[i], EDGE_NM, pieces[i], 1);
        else if (s->half_gap[l] == 0)
            now = 1.0;
        else
            now = piece(s->ahead[l] + s->h * w[i], s->half_gap[l], EDGE_RAD, pieces[i], 0);
        changed |= now != pieces[i];
        pieces[i] = now;
    }
    return changed;
}

/* -- the tree ------------------------------------------------------------------------------ */

typedef struct {
    double c, s;
} Line;

INLINE void lines(const Rows *r, const Stage *s, const double *pieces, Line *law)
{
    for (int i = 0; i < r->limited; i++) {
        law[i].c = pieces[i] == 0 ? s->offset[i] : pieces[i] * s->limit[i];
        law[i].s = pieces[i] == 0 ? s->slope[i] : 0.0;
    }
    for (int l = 0; l < r->plays; l++) {
        double piece_ = pieces[r->limited + l], pressed = s->stiff[l] * fabs(piece_);
        law[r->limited + l].c = pressed * (s->ahead[l] - piece_ * s->half_gap[l]);
        law[r->limited + l].s = pressed * s->h;
    }
}

/* Take body `of` and its law from the equations: `drag` and `push` of the body that drives it, at
 * this ratio, gain its share. Only the first side has the law's constant part. */
INLINE void take_out(Line law, int sides, int of, int to, double ratio, double *drag, double *push)
{
    double d = drag[of], share = 1.0 / (d + law.s);
    drag[to] += ratio * ratio * (law.s * d * share);
    for (int k = 0; k < sides; k++) {
        double c = k ? 0.0 : law.c;
        push[to * sides + k] -= ratio * ((c * d - law.s * push[of * sides + k]) * share);
    }
}

/* Put body `of` back, once the speed of its driver is known. */
INLINE void put_back(Line law, int sides, int of, int to, double ratio, const double *drag,
                     const double *push, double *v)
{
    double d = drag[of] + law.s;
    for (int k = 0; k < sides; k++)
        v[of * sides + k] = (push[of * sides + k] + (k ? 0.0 : law.c) + law.s * ratio * v[to * sides + k]) / d;
}

/* Speeds without coupling, for linear laws, of several right-hand sides at once: `push` and `v` are
 * bodies x sides. The first side is the stage's; the others have neither reference nor constants. */
INLINE void tree(const Rows *r, const Stage *s, const Line *law, int sides, double *push, double *v)
{
    int m = r->m;
    double drag[BODIES];
    memcpy(drag, s->drag, (size_t)r->bodies * sizeof(double));
    for (int i = 0; i <= m; i++) {
        drag[r->links + i] += law[2 + 2 * m + i].s;
        push[(r->links + i) * sides] -= law[2 + 2 * m + i].c;
        drag[driver(r, i)] += law[3 + 3 * m + i].s;
        push[driver(r, i) * sides] -= law[3 + 3 * m + i].c;
    }
    for (int j = m - 1; j >= 0; j--) {
        int axis = r->axes + j, stage = r->stages + j;
        take_out(law[r->limited + 2 + j], sides, r->links + 1 + j, axis, 1.0, drag, push);
        take_out(law[2 + m + j], sides, axis, stage, s->second[j], drag, push);
        take_out(law[2 + j], sides, stage, driver(r, j), s->first[j], drag, push);
    }
    for (int i = 0; i < 2; i++) {
        Line play = law[r->limited + i];
        take_out(play, sides, r->disk + i, i, 1.0, drag, push);
        for (int k = 0; k < sides; k++)
            v[i * sides + k] = (push[i * sides + k] + (k ? 0.0 : law[i].c) +
                                law[i].s * (k ? 0.0 : s->reference[i])) / (drag[i] + law[i].s);
        put_back(play, sides, r->disk + i, i, 1.0, drag, push, v);
    }
    for (int j = 0; j < m; j++) {
        int axis = r->axes + j, stage = r->stages + j;
        put_back(law[2 + j], sides, stage, driver(r, j), s->first[j], drag, push, v);
        put_back(law[2 + m + j], sides, axis, stage, s->second[j], drag, push, v);
        put_back(law[r->limited + 2 + j], sides, r->links + 1 + j, axis, 1.0, drag, push, v);
    }
}

/* Solve n equations a x = b by Gaussian elimination with partial pivoting; x holds b on entry. */
INLINE void eliminate(int n, double a[LINKS][LINKS], double *x)
{
    for (int k = 0; k < n; k++) {
        int most = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(a[i][k]) > fabs(a[most][k]))
                most = i;
        for (int j = k; j < n; j++) {
            double other = a[k][j];
            a[k][j] = a[most][j];
            a[most][j] = other;
        }
        double right = x[k];
        x[k] = x[most];
        x[most] = right;
        for (int i = k + 1; i < n; i++) {
            double part = a[i][k] / a[k][k];
            for (int j = k + 1; j < n; j++)
                a[i][j] -= part * a[k][j];
            x[i] -= part * x[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++)
            x[k] -= a[k][j] * x[j];
        x[k] /= a[k][k];
    }
}

/* Speeds of all bodies with every law on a known piece; coupled links answer a unit push each. */
INLINE void speeds(const Rows *r, const Stage *s, const double *pieces, double *v)
{
    int n = r->m + 1, sides = s->coupled ? 1 + n : 1;
    Line law[LAWS];
    double push[BODIES * SIDES], answer[BODIES * SIDES];
    lines(r, s, pieces, law);
    for (int i = 0; i < r->bodies; i++)
        for (int k = 0; k < sides; k++)
            push[i * sides + k] = k ? i == r->links + k - 1 : s->push[i];
    if (s->coupled)
        tree(r, s, law, 1 + n, push, answer);
    else
        tree(r, s, law, 1, push, answer);
    for (int i = 0; i < r->bodies; i++)
        v[i] = answer[i * sides];
    if (!s->coupled)
        return;
    double system[LINKS][LINKS], own[LINKS];
    for (int i = 0; i < n; i++) {
        const double *link = answer + (r->links + i) * sides;
        own[i] = link[0];
        for (int k = 0; k < n; k++) {
            system[i][k] = i == k;
            for (int j = 0; j < n; j++)
                system[i][k] += link[1 + j] * s->coupling[j * n + k];
        }
    }
    eliminate(n, system, own);
    for (int j = 0; j < n; j++) {
        double pull = 0.0;
        for (int k = 0; k < n; k++)
            pull += s->coupling[j * n + k] * own[k];
        for (int i = 0; i < r->bodies; i++)
            v[i] -= answer[i * sides + 1 + j] * pull;
    }
}

/* -- the convex function ------------------------------------------------------------------- */

static double slope_along(const Rows *r, const Stage *s, const double *v, const double *way)
{
    static const double none[2] = {0.0, 0.0};
    double w[LAWS], torque[LAWS], along[LAWS], sum = 0.0;
    relative(r, s, v, s->reference, w);
    torques(r, s, w, torque);
    relative(r, s, way, none, along);
    for (int i = 0; i < r->bodies; i++)
        sum += way[i] * (s->drag[i] * v[i] - s->push[i]);
    for (int i = 0, n = r->m + 1; i < n && s->coupled; i++)
        for (int k = 0; k < n; k++)
            sum += way[r->links + i] * s->coupling[i * n + k] * v[r->links + k];
    for (int i = 0; i < r->limited + r->plays; i++)
        sum += along[i] * torque[i];
    return sum;
}

/* Move `end` to the minimum of the convex function on the segment from `start` to `end`. */
static NOINLINE void search(const Rows *r, const Stage *s, const double *start, double *end)
{
    double way[BODIES], at[BODIES], low = 0.0, high = 1.0;
    for (int i = 0; i < r->bodies; i++)
        way[i] = end[i] - start[i];
    for (int i = 0; i < r->bodies; i++)
        at[i] = end[i] - NEAR_END * way[i];
    if (slope_along(r, s, at, way) <= 0)
        return;
    for (int k = 0; k < HALVINGS; k++) {
        double middle = (low + high) / 2;
        for (int i = 0; i < r->bodies; i++)
            at[i] = start[i] + middle * way[i];
        if (slope_along(r, s, at, way) > 0)
            high = middle;
        else
            low = middle;
    }
    for (int i = 0; i < r->bodies; i++)
        end[i] = start[i] + (low + high) / 2 * way[i];
}

INLINE void solve(const Rows *r, const Stage *s, double *pieces, double *v)
{
    speeds(r, s, pieces, v);
    for (int count = 0; pieces_at(r, s, v, pieces) && count < MOST_PASSES; count++) {
        double before[BODIES];
        memcpy(before, v, (size_t)r->bodies * sizeof(double));
        speeds(r, s, pieces, v);
        if (count >= FULL_PASSES)
            search(r, s, before, v);
    }
}

/* -- the step ------------------------------------------------------------------------------ */

/* C cos psi at P1, P2, P3 of each stage under the loads of `chain_loads` in contacts.py, and the
 * fraction of the rate that each transmits. Return the number of the first contact from motor 1 on
 * that slips grossly, or -1. */
static int friction_left(const Rows *r, const Masses *p, const double *y, const double *cosine,
                         const double *sideways, const double *disk, double hold[JOINTS][3],
                         double part[JOINTS][3])
{
    double later = 0.0, capacity = *p->capacity, way[JOINTS];
    int slipping = -1;
    for (int j = 0; j < r->m; j++) {
        double turned = disk[j] > 0 ? 1.0 : disk[j] < 0 ? -1.0 : 0.0;
        way[j] = cosine[j] < 0 ? -turned : turned;
    }
    for (int j = r->m - 1; j >= 0; j--) {
        double c = larger(fabs(cosine[j]), LEAST_COSINE), s = sideways[j];
        double most = capacity * c / sqrt(c * c + s * s);
        double load = p->k[0] * (y[r->torque + 2 + j] * way[j]);
        for (int place = 2; place >= 0; place--) {
            load += place ? 0.0 : later;
            double carried = larger(load < most ? load : most, -MOST_SHARE * capacity);
            double left = sqrt(larger(capacity * capacity - carried * carried, 0.0));
            left = hold[j][place] = larger(left, LEAST_TORQUE_NM);
            double passed = load < most ? larger(1.0 - s * carried / (c * left), 0.0) : 0.0;
            part[j][place] = passed;
            if (passed <= 0 && p->disk[j] * fabs(disk[j]) > SLIP_SPEED_RAD_S)
                slipping = 3 * j + place;
            load = carried * c + s * left;
        }
        if (j)
            later = p->k[j] / p->k[j - 1] * load;
    }
    return slipping;
}

/* Mass matrix of the links (see `chain_inertia`), and the reduction of `pull` by their rotation. */
static void reaction(const Rows *r, const Masses *p, const double *y, const double *gained, double h,
                     double lead, Gears *g)
{
    int m = r->m, n = m + 1;
    double angle[LINKS], rate[LINKS], back[LINKS] = {0.0};
    for (int i = 0; i < n; i++) {
        double speed = y[r->links + i];
        angle[i] = y[r->q + 1 + i] + h / 2 * speed + (i ? angle[i - 1] : 0.0);
        rate[i] = speed + lead * gained[m + i] + (i ? rate[i - 1] : 0.0);
    }
    for (int j = 0; j < n; j++) {
        g->mass[j * n + j] = p->inertia[r->links + j];
        for (int k = j + 1; k < n; k++) {
            double arm = p->lengths[j] * p->moments[k], cosine = 0.0;
            if (arm > 0) {
                double pull = arm * sine_of(angle[j] - angle[k]);
                cosine = arm * cosine_of(angle[j] - angle[k]);
                back[j] += pull * rate[k] * rate[k];
                back[k] -= pull * rate[j] * rate[j];
            }
            g->mass[j * n + k] = g->mass[k * n + j] = cosine;
        }
    }
    for (int j = m - 1; j >= 0; j--) {
        back[j] += back[j + 1];
        for (int k = 0; k < n; k++)
            g->mass[j * n + k] += g->mass[(j + 1) * n + k];
    }
    g->coupled = 0;
    for (int j = 0; j < n; j++) {
        g->pull[j] -= back[j];
        for (int k = m - 1; k >= 0; k--) {
            g->mass[j * n + k] += g->mass[j * n + k + 1];
            g->coupled |= j <= k && g->mass[j * n + k + 1] != 0;
        }
    }
}

static int gears(const Rows *r, const Masses *p, const double *y, const double *gained, double h,
                 double lead, Gears *g)
{
    int m = r->m;
    double cosine[JOINTS], sideways[JOINTS], disk[JOINTS], hold[JOINTS][3];
    double part[JOINTS][3];
    for (int j = 0; j < m; j++) {
        double c = cosine[j] = cosine_of(y[r->q + 1 + j] + h / 2 * y[r->links + j]);
        sideways[j] = *p->lateral * sqrt(larger(1.0 - c * c, 0.0));
        disk[j] = y[driver(r, j)] + lead * gained[j];
    }
    int slipping = friction_left(r, p, y, cosine, sideways, disk, hold, part);
    memset(g->drag, 0, sizeof g->drag);
    for (int j = 0; j < m; j++) {
        double c = larger(fabs(cosine[j]), LEAST_COSINE), kept = larger(*p->kept, 0.0);
        double lost[3], drag[3], turning = fabs(disk[j]);
        for (int i = 0; i < 3; i++) {
            lost[i] = *p->creep * c + sideways[j] / hold[j][i];
            drag[i] = sideways[j] * hold[j][i];
        }
        double second = p->k[j] * cosine[j] * cosine[j] * kept * kept;
        g->first[j] = cosine[j] * kept;
        g->second[j] = second * larger(1.0 - drag[2] * lost[1] / c, 0.0);
        double slip1 = turning / p->disk[j] * lost[0];
        double speed = p->k[j] * turning * part[j][0] * (p->k[0] * c) * c;
        double slip23 = speed * (c * lost[1] + part[j][1] * lost[2]);
        double room = (*p->capacity - drag[2]) / c;
        g->slope[j] = 1 / (slip1 + 1 / STICTION_SLOPE);
        g->slope[m + j] = 1 / (slip23 + 1 / STICTION_SLOPE);
        g->limit[j] = *p->capacity * p->disk[j];
        g->limit[m + j] = (*p->capacity < room ? *p->capacity : room) / p->k[0];
        g->drag[j] += p->disk[j] * drag[0];
        g->drag[j + 1] += p->disk[j] * (drag[1] + c * drag[2]);
    }
    double angle = 0.0, load = 0.0;
    for (int i = 0; i <= m; i++) {
        angle += y[r->q + 1 + i] + h / 2 * y[r->links + i];
        g->pull[i] = p->weights[i] * cosine_of(angle);
    }
    for (int i = m; i >= 0; i--)
        g->pull[i] = load -= g->pull[i];
    reaction(r, p, y, gained, h, lead, g);
    return slipping;
}

/* The state y + h f(new state) by the implicit Euler method; power[0]: motors, power[1]: losses. */
INLINE void stage_of(const Rows *r, const Masses *p, const Gears *g, const double *y,
                     const double *reference, double h, double k_g, double *pieces, double *new,
                     double *power)
{
    int m = r->m;
    double fed[2], w[LAWS], torque[LAWS], work = 0.0, lost = 0.0, even = 0.0;
    Stage s;
    s.h = h;
    for (int i = 0; i < r->bodies; i++) {
        s.drag[i] = p->inertia[i] / h + LEAST_DRAG;
        s.push[i] = p->inertia[i] / h * y[i];
    }
    s.coupled = g->coupled;
    for (int i = 0, n = m + 1; i < n; i++) {
        double push = 0.0;
        for (int k = 0; k < n; k++) {
            double heavy = g->mass[i * n + k] / h;
            s.coupling[i * n + k] = i == k ? 0.0 : heavy;
            push += heavy * y[r->links + k];
        }
        s.drag[r->links + i] = g->mass[i * n + i] / h + LEAST_DRAG;
        s.push[r->links + i] = push;
    }
    for (int i = 0; i < 2; i++) {
        s.reference[i] = reference[i];
        fed[i] = p->inertia[i] / h * (reference[i] - y[r->reference + i]);
        s.offset[i] = p->integral[i] * y[r->behind + i] + fed[i];
        s.slope[i] = p->gain[i] + p->integral[i] * h;
        s.limit[i] = p->limit[i];
    }
    for (int j = 0; j < m; j++) {
        s.drag[r->links + 1 + j] += p->viscous[j];
        s.first[j] = g->first[j];
        s.second[j] = g->second[j];
    }
    for (int i = 0; i < 2 * m; i++) {
        s.offset[2 + i] = 0.0;
        s.slope[2 + i] = g->slope[i];
        s.limit[2 + i] = g->limit[i];
    }
    for (int i = 0; i <= m; i++) {
        s.push[r->links + i] += g->pull[i];
        s.offset[2 + 2 * m + i] = 0.0;
        s.slope[2 + 2 * m + i] = p->coulomb[i] > 0 ? STICTION_SLOPE : 0.0;
        s.limit[2 + 2 * m + i] = p->coulomb[i];
        s.offset[3 + 3 * m + i] = 0.0;
        s.slope[3 + 3 * m + i] = g->drag[i] > 0 ? STICTION_SLOPE : 0.0;
        s.limit[3 + 3 * m + i] = g->drag[i];
    }
    for (int i = 0; i < r->plays; i++) {
        s.stiff[i] = p->stiffness[i] + p->damping[i] / h;
        s.ahead[i] = y[r->gap + i] + y[r->twist + i] * p->stiffness[i] / s.stiff[i];
        s.half_gap[i] = p->half_gap[i];
    }
    solve(r, &s, pieces, new);
    relative(r, &s, new, s.reference, w);
    torques(r, &s, w, torque);
    for (int i = 0; i < 2; i++) {
        double loop = torque[i] - fed[i] + p->gain[i] / h * y[r->behind + i];
        new[r->behind + i] = loop / (p->gain[i] / h + p->integral[i]);
        new[r->reference + i] = reference[i];
        work += torque[i] * new[i];
    }
    for (int i = 0; i < r->plays; i++) {
        double pressed = torque[r->limited + i] + p->damping[i] / h * y[r->twist + i];
        new[r->torque + i] = torque[r->limited + i];
        double twist = new[r->twist + i] = pressed / s.stiff[i];
        double wound = (twist - y[r->twist + i]) / h;
        new[r->gap + i] = clip(s.ahead[i] + h * w[r->limited + i], p->half_gap[i]);
        lost += p->damping[i] * wound * wound;
    }
    new[r->q] = y[r->q] + h * k_g * new[driver(r, m - 1)];
    for (int i = 0; i <= m; i++)
        new[r->q + 1 + i] = y[r->q + 1 + i] + h * new[r->links + i];
    for (int i = 2; i < r->limited; i++)
        lost += torque[i] * w[i];
    for (int j = 0; j < m; j++)
        lost += p->viscous[j] * new[r->links + 1 + j] * new[r->links + 1 + j];
    for (int i = 0; i < r->bodies; i++)
        even += new[i] * new[i];
    power[0] = work;
    power[1] = lost + LEAST_DRAG * even;
}

/* Arms of three and four joints have copies of their own, in which the compiler knows every count. */
#define COPY(NAME, M)                                                                             \
    static NOINLINE void NAME(int m, const Masses *p, const Gears *g, const double *y,            \
                              const double *reference, double h, double k_g, double *pieces,      \
                              double *new, double *power)                                         \
    {                                                                                             \
        Rows r = rows_of(M);                                                                      \
        (void)m;                                                                                  \
        stage_of(&r, p, g, y, reference, h, k_g, pieces, new, power);                             \
    }
COPY(stage_two, 2)
COPY(stage_three, 3)
COPY(stage_any, m)

static void stage(int m, const Masses *p, const Gears *g, const double *y, const double *reference,
                  double h, double k_g, double *pieces, double *new, double *power)
{
    (m == 2 ? stage_two : m == 3 ? stage_three : stage_any)(m, p, g, y, reference, h, k_g, pieces,
                                                            new, power);
}

static void step(const Rows *r, const Masses *p, const double *mean, const double *swing, double h,
                 double lead, double gamma, double k_g, double *y, double *pieces, double *gained,
                 double *energy, double *slipping)
{
    int laws = r->limited + r->plays;
    double one[STATE], two[STATE], early[LAWS], late[LAWS], power[2][2], reference[2];
    size_t size = (size_t)laws * sizeof(double);
    Gears g;
    *slipping = gears(r, p, y, gained, h, lead, &g);
    for (int i = 0; i < 2; i++)
        reference[i] = mean[i] + (gamma - 0.5) * swing[i];
    memcpy(early, pieces, size);
    stage(r->m, p, &g, y, reference, gamma * h, k_g, early, one, power[0]);
    double before[STATE], factor = (1 - gamma) / gamma;
    for (int i = 0; i < r->count; i++)
        before[i] = y[i] + factor * (one[i] - y[i]);
    for (int i = 0; i < 2; i++)
        reference[i] = mean[i] + swing[i] / 2;
    memcpy(late, early, size);
    stage(r->m, p, &g, before, reference, gamma * h, k_g, late, two, power[1]);
    double weight[2] = {(1 - gamma) * h, gamma * h};
    if (memcmp(early, pieces, size) || memcmp(late, pieces, size)) {
        memcpy(late, pieces, size);
        for (int i = 0; i < 2; i++)
            reference[i] = mean[i] - swing[i] / 4;
        stage(r->m, p, &g, y, reference, h / 2, k_g, late, one, power[0]);
        for (int i = 0; i < 2; i++)
            reference[i] = mean[i] + swing[i] / 4;
        stage(r->m, p, &g, one, reference, h / 2, k_g, late, two, power[1]);
        weight[0] = weight[1] = h / 2;
    }
    for (int j = 0; j < r->m; j++)
        gained[j] = two[driver(r, j)] - y[driver(r, j)];
    for (int i = 0; i <= r->m; i++)
        gained[r->m + i] = two[r->links + i] - y[r->links + i];
    for (int i = 0; i < 2; i++)
        energy[i] += weight[0] * power[0][i] + weight[1] * power[1][i];
    memcpy(y, two, (size_t)r->count * sizeof(double));
    memcpy(pieces, late, size);
}

static void take(const double *from, double *to, int count, int64_t samples)
{
    for (int i = 0; i < count; i++)
        to[i] = from[i * samples];
}

static void put(const double *from, double *to, int count, int64_t samples)
{
    for (int i = 0; i < count; i++)
        to[i * samples] = from[i];
}

/* Advance all samples by a step. Arrays are (rows, samples); y has `rows` rows. Return -1 if there
 * are too many joints, or if Python counts the rows of the state differently. */
EXPORT int planner_dynamic_march(int64_t m, int64_t rows, int64_t samples, double h, double lead,
                                 double gamma, double k_g, const double *masses,
                                 const double *mean, const double *swing, double *y,
                                 double *pieces, double *gained, double *energy,
                                 double *slipping)
{
    if (m > JOINTS || rows != rows_of((int)m).count)
        return -1;
    Rows r = rows_of((int)m);
    int laws = r.limited + r.plays;
    for (int64_t k = 0; k < samples; k++) {
        double own[STATE], own_pieces[LAWS], own_gained[2 * JOINTS + 1], own_energy[2];
        double own_mean[2], own_swing[2];
        Masses p = masses_of((int)m, masses + k, samples);
        take(y + k, own, r.count, samples);
        take(pieces + k, own_pieces, laws, samples);
        take(gained + k, own_gained, 2 * r.m + 1, samples);
        take(energy + k, own_energy, 2, samples);
        take(mean + k, own_mean, 2, samples);
        take(swing + k, own_swing, 2, samples);
        step(&r, &p, own_mean, own_swing, h, lead, gamma, k_g, own, own_pieces, own_gained, own_energy,
             slipping + k);
        put(own, y + k, r.count, samples);
        put(own_pieces, pieces + k, laws, samples);
        put(own_gained, gained + k, 2 * r.m + 1, samples);
        put(own_energy, energy + k, 2, samples);
    }
    return 0;
}
