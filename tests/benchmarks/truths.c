/* An arm to try the package on: it shares no code with planner/machine. See truths.py.
 *
 * Explicit steps of some tenths of a millisecond, from the equations of docs/theory.md. Motors and
 * gearheads drive disks and joint 1; contacts pass a part of their rate on; an axis pulls its joint
 * through a gap and a soft shaft against friction. Without inertia a joint turns as fast as its
 * viscous friction lets it. With inertia the links 2 and 3 are a planar chain, and friction is an
 * impulse that stops a joint or not (Moreau's time stepping). What is 0 in Arm is not there.
 */

#include <math.h>

enum { PENDING = 6 };

typedef struct {
    double step_s;
    double gain[2], bias[2];       /* of the motors; rad/s while a run lasts */
    double bandwidth[2], damping;  /* first order where damping is 0 */
    double most_speed, most_ramp;  /* rad/s, rad/s2 */
    double gearhead[2];            /* half of the play, rad */
    double k_g, k[2];              /* of the last disk, of joints 2 and 3 */
    double creep, creep_per_nm, lateral, capacity;
    double eccentric[3], phase[3]; /* of the wheels of stage 2, and of joints 2 and 3 */
    double gap[2], edge;           /* half gap and width of its soft edge, rad */
    double gap_swing, friction_swing, breakaway, one_way; /* shares */
    double stiffness[2], coulomb[2], viscous[2];
    double cable[2], cable_rest[2]; /* N m/rad, rad */
    double inertia[2], reach[3];    /* of links 2, 3; couplings 1-2, 1-3, 2-3; kg m2 */
    double shaft_damping;
} Arm;

typedef struct {
    double speed[2], ramp[2], motor[2], disk, last; /* last: angle of the last disk */
    double axis[2], theta[3];
    double before, spin[2]; /* rate of joint 1 in the last step; links against the base, rad/s */
    double stuck[2];
    double command[2], pending[PENDING][3]; /* steps until it acts, u1, u2 */
    double count;
} State;

static const double SLOW_RAD_S = 0.01; /* a joint slower than that sticks */

static double clip(double x, double most) { return x > most ? most : x < -most ? -most : x; }

static double soft(double x) { return x > 0 ? x + log1p(exp(-x)) : log1p(exp(x)); }

/* Torque of a shaft whose axis leads its joint by x; `share` of its stiffness is in contact. */
static double shaft(const Arm *p, int j, double x, double theta, double *share)
{
    double half = p->gap[j] * (1 + p->gap_swing * sin(theta + 1 + j)), e = p->edge;
    if (e == 0) {
        *share = fabs(x) > half;
        return p->stiffness[j] * (x - clip(x, half));
    }
    *share = 1 / (1 + exp((half - x) / e)) + 1 / (1 + exp((half + x) / e));
    return p->stiffness[j] * e * (soft((x - half) / e) - soft((-x - half) / e));
}

/* Sliding friction of a joint that turns, or would turn, to this side. */
static double friction(const Arm *p, int j, double theta, double side)
{
    double level = p->coulomb[j] * (1 + p->friction_swing * sin(4 * theta + j));
    return side < 0 ? level * (1 - p->one_way) : level * (1 + p->one_way);
}

/* Contact under load: the torque that its driver feels; multiply `kept` by the part passed on. */
static double contact(const Arm *p, double load, double angle, double *kept)
{
    double c = cos(angle), s = p->lateral * fabs(sin(angle)), most = p->capacity;
    double limit = most * c / sqrt(c * c + s * s), x = load > limit ? limit : load;
    if (x < -0.99 * most)
        x = -0.99 * most;
    double hold = sqrt(most * most - x * x);
    double part = load >= limit ? 0 : 1 - s * x / (c * hold);
    double left = 1 - p->creep - p->creep_per_nm * (fabs(load) < most ? fabs(load) : most);
    *kept *= (part > 0 ? part : 0) * (left > 0 ? left : 0);
    return x * c + s * hold;
}

static void servo(const Arm *p, State *x, int i, int running, double h)
{
    double wanted = clip(p->gain[i] * x->command[i] + (running ? p->bias[i] : 0), p->most_speed);
    double b = p->bandwidth[i], before = x->speed[i], after;
    if (p->damping > 0) {
        x->ramp[i] += h * (b * b * (wanted - before) - 2 * p->damping * b * x->ramp[i]);
        x->ramp[i] = clip(x->ramp[i], p->most_ramp);
        after = before + h * x->ramp[i];
    } else
        after = before + clip((wanted - before) * -expm1(-b * h), p->most_ramp * h);
    x->speed[i] = after;
    x->motor[i] += h * (before + after) / 2;
}

/* Turn the axes of joints 2 and 3 through the disks, which motor 1 turns by `turn`. */
static void disks(const Arm *p, State *x, double turn, double *axis_rate, double h)
{
    double side = turn > 0 ? 1 : -1, share, c2 = cos(x->theta[0]), c3 = cos(x->theta[1]);
    double kept[2][2] = {{1, 1}, {1, 1}}; /* stage and branch of each joint */
    double behind = 0;
    axis_rate[0] = axis_rate[1] = 0;
    if (turn == 0)
        return;
    for (int j = 1; j >= 0; j--) {
        double lead = x->axis[j] - x->theta[j + 1];
        double load = p->k[0] * side * shaft(p, j, lead, x->theta[j + 1], &share);
        load = contact(p, load, x->theta[j], &kept[j][1]);
        load = contact(p, load, x->theta[j], &kept[j][1]);
        behind = p->k[1] / p->k[0] * contact(p, load + behind, x->theta[j], &kept[j][0]);
    }
    double wheel = x->disk, disk = turn * c2 * kept[0][0];
    double way = p->k[0] * disk * c2 * c2 * kept[0][1];
    axis_rate[0] = way * (1 + p->eccentric[1] * sin(wheel + p->phase[1])) / h;
    disk *= 1 + p->eccentric[0] * sin(wheel + p->phase[0]);
    x->last += p->k_g * disk;
    way = p->k[1] * disk * c3 * kept[1][0] * c3 * c3 * kept[1][1];
    axis_rate[1] = way * (1 + p->eccentric[2] * sin(x->last + p->phase[2])) / h;
}

static double pulled(const Arm *p, const State *x, int j, double *share)
{
    double theta = x->theta[j + 1], torque = shaft(p, j, x->axis[j] - theta, theta, share);
    return torque - p->cable[j] * (theta - p->cable_rest[j]);
}

/* A joint without inertia. */
static void creep(const Arm *p, State *x, int j, double h)
{
    double share, torque = pulled(p, x, j, &share), side = torque < 0 ? -1 : 1;
    double over = fabs(torque) - friction(p, j, x->theta[j + 1], side);
    if (x->stuck[j] && over <= p->breakaway * friction(p, j, x->theta[j + 1], side))
        return;
    double rate = over > 0 ? over / p->viscous[j] : 0;
    x->theta[j + 1] += side * rate * h;
    x->stuck[j] = rate < SLOW_RAD_S;
}

/* Links 2 and 3 with inertia; joint 1 turns at `rate`. */
static void swing(const Arm *p, State *x, double rate, const double *axis_rate, double h)
{
    double *v = x->spin, joint[2] = {v[0] - rate, v[1] - v[0]}, drive[2], most[2], impulse[2] = {0, 0};
    for (int j = 0; j < 2; j++) {
        double share, torque = pulled(p, x, j, &share), lead = axis_rate[j] - joint[j];
        double damp = share * p->shaft_damping * lead, pull = shaft(p, j, x->axis[j] - x->theta[j + 1],
                                                                     x->theta[j + 1], &share);
        if (pull * (pull + damp) < 0) /* teeth push, they never pull */
            damp = -pull;
        drive[j] = torque + damp - p->viscous[j] * joint[j];
        double side = joint[j] != 0 ? joint[j] : drive[j], held = fabs(joint[j]) < SLOW_RAD_S;
        most[j] = h * friction(p, j, x->theta[j + 1], side) * (1 + held * p->breakaway);
    }
    double c12 = p->reach[0] * cos(x->theta[1]), c23 = p->reach[2] * cos(x->theta[2]);
    double s12 = p->reach[0] * sin(x->theta[1]), s23 = p->reach[2] * sin(x->theta[2]);
    double c13 = p->reach[1] * cos(x->theta[1] + x->theta[2]);
    double s13 = p->reach[1] * sin(x->theta[1] + x->theta[2]);
    double jerk = rate - x->before, a = p->inertia[0], b = p->inertia[1], det = a * b - c23 * c23;
    double push[2] = {h * (drive[0] - drive[1] - s12 * rate * rate + s23 * v[1] * v[1]) - c12 * jerk,
                      h * (drive[1] - s13 * rate * rate - s23 * v[0] * v[0]) - c13 * jerk};
    v[0] += (b * push[0] - c23 * push[1]) / det;
    v[1] += (a * push[1] - c23 * push[0]) / det;
    for (int i = 0; i < 30; i++)
        for (int j = 0; j < 2; j++) {
            /* an impulse on joint 2 moves link 2; one on joint 3 moves both, against each other */
            double d0 = j ? (-b - c23) / det : b / det, d1 = j ? (a + c23) / det : -c23 / det;
            double now = j ? v[1] - v[0] : v[0] - rate, stop = j ? d1 - d0 : d0;
            double next = clip(impulse[j] - now / stop, most[j]), more = next - impulse[j];
            impulse[j] = next;
            v[0] += more * d0;
            v[1] += more * d1;
        }
    x->theta[1] += h * (v[0] - rate);
    x->theta[2] += h * (v[1] - v[0]);
    x->before = rate;
}

static void step(const Arm *p, State *x, int running)
{
    double h = p->step_s, axis_rate[2], was = x->disk, first = x->theta[0];
    int taken = 0;
    for (int i = 0; i < (int)x->count; i++)
        if (x->pending[i][0]-- <= 0)
            x->command[0] = x->pending[i][1], x->command[1] = x->pending[i][2], taken = i + 1;
    for (int i = taken; i < (int)x->count; i++)
        for (int k = 0; k < 3; k++)
            x->pending[i - taken][k] = x->pending[i][k];
    x->count -= taken;
    servo(p, x, 0, running, h);
    servo(p, x, 1, running, h);
    x->disk = x->motor[0] - clip(x->motor[0] - was, p->gearhead[0]);
    double ahead = x->motor[1] - clip(x->motor[1] - first, p->gearhead[1]);
    disks(p, x, x->disk - was, axis_rate, h);
    x->axis[0] += h * axis_rate[0];
    x->axis[1] += h * axis_rate[1];
    x->theta[0] = ahead;
    if (p->inertia[0] > 0)
        swing(p, x, (ahead - first) / h, axis_rate, h);
    else
        creep(p, x, 0, h), creep(p, x, 1, h);
}

/* Run `ticks` periods of `steps` steps: the command of a period arrives `late` steps after its
 * beginning. `theta` (ticks, 3): the joints at the beginning of each period. */
void run(const Arm *p, State *x, int ticks, int steps, const double *u, const double *late,
         int running, double *theta)
{
    for (int t = 0; t < ticks; t++) {
        for (int i = 0; i < 3; i++)
            theta[3 * t + i] = x->theta[i];
        double *next = x->pending[(int)x->count++];
        next[0] = late[t], next[1] = u[2 * t], next[2] = u[2 * t + 1];
        for (int k = 0; k < steps; k++)
            step(p, x, running);
    }
}
