/* The tracker of planner/machine/feedback for a single machine. In each period it reads, estimates,
 * predicts, optimises and commands. An exact active-set method replaces OSQP. */
#include "tracker.h"

#include <math.h>
#include <string.h>

typedef tracker_real real;

#include "tables.h"

enum {
    N = TRACKER_COORDINATES,
    J = N - 1,         /* joints with an axis: coordinate j + 1 */
    P = N - 2,         /* passive ones: coordinate i + 2 */
    X = N + 2 + 2 * P, /* state: deviation, last corrections, rate errors, lost motion */
    M = TRACKER_TICKS,
    H = TRACKER_HORIZON,
    C = 2 * H,
    K = TRACKER_PERIODS,
    L = STATE_LIMITS,
    CHANGES = C, /* rows: corrections, their changes if rates are limited, states */
    STATES = C + RATED * C,
    ROWS = STATES + H * L
};

static real clip(real x, real low, real high) { return x < low ? low : x > high ? high : x; }
static real sign(real x) { return (real)((x > 0) - (x < 0)); }
static real positive(real x) { return x > 0 ? x : 0; }
static real negative(real x) { return x < 0 ? x : 0; }

/* -- prediction on the nominal machine ---------------------------------------------------------- */

/* Update the pose after both motors have turned by `travel`. `passing` is the share of each joint's
 * rate that its contacts transmit. */
static void turn(tracker_pose *pose, const real travel[2], const real *lost, const real *error,
                 const real *passing) {
    const real moved = pose->side + travel[0];
    real past[2], change[N], middle[N];
    pose->side = clip(moved, -DRIVE_PLAY / 2, DRIVE_PLAY / 2);
    past[0] = moved - pose->side;
    past[1] = travel[1];
    nominal_rates(pose->q, past, change);
    for (int i = 0; i < N; i++) middle[i] = pose->q[i] + change[i] / 2;
    nominal_rates(middle, past, change);
    pose->q[0] += change[0];
    for (int j = 0; j < J; j++) {
        pose->axis[j] += passing[j] * (1 + error[j]) * change[j + 1];
        pose->q[j + 1] = clip(pose->q[j + 1], pose->axis[j] - lost[j], pose->axis[j] + lost[j]);
    }
}

static void tell(tracker *self, const real speed[2]) {
    const int now = self->ticks % TRACKER_RING, next = (now + 1) % TRACKER_RING;
    for (int m = 0; m < 2; m++) {
        self->told[now][m] = speed[m];
        self->travel[next][m] = self->travel[now][m] + TICK_S * speed[m];
    }
    self->ticks++;
}

/* Commanded position of motor m `after` ticks after tick `base`. */
static real travel_of(const tracker *self, int m, int base, real after) {
    int whole = base + (int)FN(floor)(after + ROUNDING_TICKS);
    real part = after - (real)(whole - base);
    if (self->ticks == 0) return 0;
    if (whole < 0) whole = 0, part = 0;
    if (whole >= self->ticks) whole = self->ticks - 1, part = 1;
    return self->travel[whole % TRACKER_RING][m] + part * TICK_S * self->told[whole % TRACKER_RING][m];
}

/* Predict the pose: apply each motor's commands from `done` to `until`, in ticks after `base`. */
static void forecast(const tracker *self, tracker_pose *pose, int base, const real done[2],
                     const real until[2]) {
    const real span[2] = {until[0] - done[0], until[1] - done[1]};
    const int ticks = (int)FN(ceil)((span[0] > span[1] ? span[0] : span[1]) - ROUNDING_TICKS);
    const int count = ticks > 1 ? ticks : 1;
    real before[2], step[2];
    for (int m = 0; m < 2; m++) before[m] = travel_of(self, m, base, done[m]);
    for (int part = 1; part <= count; part++) {
        for (int m = 0; m < 2; m++) {
            const real when = done[m] + (real)part / (real)count * span[m];
            const real after = travel_of(self, m, base, when);
            step[m] = after - before[m];
            before[m] = after;
        }
        turn(pose, step, self->lost_motion, self->rate_error, PASSING[self->period]);
    }
}

/* -- estimate: axis, lost motion and rate error of each joint ----------------------------------- */

static void take_forecast(tracker *self, const tracker_pose *pose) {
    for (int j = 0; j < J; j++) {
        real(*cov)[3] = self->covariance[j];
        const real moved = pose->axis[j] - self->pose.axis[j];
        const real step = moved / (1 + self->rate_error[j]);
        const real off = SETTLING_SHARE * (moved - self->last_turn[j]);
        const real way = moved == 0 ? self->way[j] : sign(moved);
        self->settling[j] = off * off;
        self->last_turn[j] = moved;
        if (MEAN_LOST_MOTION[j] > 0 && way != self->way[j]) {
            if (self->is_pushed[j]) {
                const real was = self->way[j], square = NOISE[j] * NOISE[j];
                const real spread = cov[0][0] - was * (cov[0][1] + cov[1][0]) + was * was * cov[1][1];
                self->rest_variance[j] = clip(spread, 0, square);
            }
            self->is_pushed[j] = 0;
        }
        self->rest_variance[j] += REST_SHARE * NOISE[j] * (REST_SHARE * NOISE[j]);
        self->way[j] = way;
        for (int b = 0; b < 3; b++) cov[0][b] += step * cov[2][b];
        for (int a = 0; a < 3; a++) cov[a][0] += step * cov[a][2];
        cov[0][0] += UNMODELLED_SPREAD_RAD * UNMODELLED_SPREAD_RAD;
        cov[0][0] += NOISE_SHARE * NOISE[j] * (NOISE_SHARE * NOISE[j]);
    }
    self->pose = *pose;
}

/* Update the position of a resting joint; return whether the reading shows that it is pushed. */
static int rest_at(tracker *self, int j, real seen) {
    const real square = self->rest_variance[j] + NOISE[j] * NOISE[j];
    const real change = seen - self->rest[j];
    const real beyond = EXACT_READING_SPREAD + PUSHED_SPREADS * FN(sqrt)(square);
    if (NOISE[j] > 0) {
        const real gain = self->rest_variance[j] / square;
        self->rest[j] += gain * change;
        self->rest_variance[j] *= 1 - gain;
    } else {
        self->rest[j] = seen;
    }
    return self->way[j] * change > HALF_STEP[j + 1] + beyond;
}

/* Return whether no motion of the joint explains a reading; of two such in a row only the first. */
static int jumps(tracker *self, int j, real seen) {
    const real spread = FN(sqrt)(self->rest_variance[j] + READING_VARIANCE[j]);
    const real most = HALF_STEP[j + 1] + PUSHED_SPREADS * spread + 2 * FN(fabs)(self->last_turn[j]);
    self->jumped[j] =
        NOISE[j] > 0 && !self->jumped[j] && FN(fabs)(seen - self->rest[j]) > most + NOISE[j];
    return self->jumped[j];
}

static void read_joint(tracker *self, int j, real seen) {
    real(*cov)[3] = self->covariance[j];
    const int lost = jumps(self, j, seen) || !isfinite(seen);
    const real wide = HALF_STEP[j + 1] + NOISE[j], way = self->way[j];
    real along[3], gain[3], q, inside;
    if (!lost) {
        if (rest_at(self, j, seen)) self->is_pushed[j] = 1;
        const real surprise = seen - (self->pose.axis[j] - way * self->lost_motion[j]);
        const real noise = READING_VARIANCE[j] + self->settling[j];
        for (int a = 0; a < 3; a++) along[a] = cov[a][0] - way * cov[a][1];
        const real spread = positive(along[0] - way * along[1]);
        const int fits = FN(fabs)(surprise) <= FITTING_SPREADS * FN(sqrt)(spread + noise);
        const int known = self->is_pushed[j] && fits;
        const real by = known ? spread + noise : spread;
        for (int a = 0; a < 3; a++) gain[a] = by > 0 ? along[a] / by : 0;
        if (self->is_pushed[j] && !fits) {
            self->pose.axis[j] += surprise;
        } else if (self->is_pushed[j] || way * surprise < 0) {
            self->pose.axis[j] += gain[0] * surprise;
            self->lost_motion[j] = positive(self->lost_motion[j] + gain[1] * surprise);
            self->rate_error[j] += gain[2] * surprise;
        }
        for (int a = 0; known && a < 3; a++)
            for (int b = 0; b < 3; b++) cov[a][b] -= gain[a] * along[b];
    }
    q = NOISE[j] > 0 ? self->rest[j] : self->pose.q[j + 1];
    if (self->is_pushed[j]) q = self->pose.axis[j] - way * self->lost_motion[j];
    inside = lost ? q : clip(q, seen - wide, seen + wide);
    if (self->is_pushed[j] || way == 0) self->pose.axis[j] += inside - q;
    if (self->is_pushed[j] && NOISE[j] > 0) self->rest[j] = inside;
    self->pose.q[j + 1] = inside;
}

/* -- the programme of one period: least |c|^2 within low <= value + T c <= high ------------------- */

/* c is the deviation from the regulator (linear control law) over the horizon. A row is a limited
 * quantity: a correction, its change, or a combination of states. value is its value for c = 0. */
static struct {
    real value[ROWS], low[ROWS], high[ROWS], length[ROWS], T[ROWS][C];
    real basis[C][C], triangle[C][C]; /* of the active rows */
    real change[N + 2][C], next[N + 2][C];
} work;

static void set_row(int row, real value, real low, real high) {
    work.value[row] = value;
    work.low[row] = low;
    work.high[row] = high;
}

/* Advance the state by one period under the regulator, and compute its correction. */
static void advance(int i, real state[X], real correction[2]) {
    real next[N];
    for (int m = 0; m < 2; m++) {
        correction[m] = 0;
        for (int b = 0; b < X; b++) correction[m] -= GAIN[i][m][b] * state[b];
    }
    for (int a = 0; a < N; a++) {
        next[a] = B[i][a][0] * correction[0] + B[i][a][1] * correction[1];
        for (int b = 0; b < N; b++) next[a] += A[i][a][b] * state[b];
#if RATED
        for (int m = 0; m < 2; m++) next[a] += B_BEFORE[i][a][m] * state[N + m];
#endif
        for (int b = 0; b < 2 * P; b++) next[a] += E[i][a][b] * state[N + 2 + b];
    }
    memcpy(state, next, sizeof next);
    memcpy(state + N, correction, 2 * sizeof(real));
}

/* Compute the rows for c = 0 from period k on; return whether one violates its limits. */
static int roll_out(int k, real state[X]) {
    int bound = 0;
    for (int row = 0; row < ROWS; row++) set_row(row, 0, -FREE, FREE);
    for (int j = 0; j < H && k + j < K; j++) {
        const int i = k + j;
        real v[2], w[2];
        memcpy(w, state + N, sizeof w);
        advance(i, state, v);
        for (int m = 0; m < 2; m++) {
            set_row(2 * j + m, v[m], LOW[i][m], HIGH[i][m]);
#if RATED
            set_row(CHANGES + 2 * j + m, v[m] - w[m], CHANGE_LOW[i][m], CHANGE_HIGH[i][m]);
#endif
        }
        for (int l = 0; l < L; l++) {
            real at = 0;
            for (int b = 0; b < N; b++) at += LIMITED[i][l][b] * state[b];
            set_row(STATES + j * L + l, at, FLOOR[i][l], CEILING[i][l]);
        }
    }
    for (int row = 0; row < ROWS; row++)
        bound |= work.value[row] < work.low[row] - LIMIT_ROUNDING ||
                 work.value[row] > work.high[row] + LIMIT_ROUNDING;
    return bound;
}

/* Compute T, the derivatives of the rows by c, and their norms. */
static void respond(int k) {
    memset(work.T, 0, sizeof work.T);
    memset(work.change, 0, sizeof work.change);
    for (int j = 0; j < H && k + j < K; j++) {
        const int i = k + j, wide = 2 * j + 2;
        for (int m = 0; m < 2; m++) {
            real *row = work.T[2 * j + m];
            for (int b = 0; b < N + 2; b++)
                for (int c = 0; c < wide - 2; c++) row[c] -= GAIN[i][m][b] * work.change[b][c];
            row[2 * j] += ROOT[i][m][0];
            row[2 * j + 1] += ROOT[i][m][1];
            memcpy(work.next[N + m], row, sizeof work.next[0]);
#if RATED
            for (int c = 0; c < wide; c++)
                work.T[CHANGES + 2 * j + m][c] = row[c] - work.change[N + m][c];
#endif
        }
        for (int a = 0; a < N; a++)
            for (int c = 0; c < wide; c++) {
                real sum = B[i][a][0] * work.T[2 * j][c] + B[i][a][1] * work.T[2 * j + 1][c];
                for (int b = 0; b < N; b++) sum += A[i][a][b] * work.change[b][c];
#if RATED
                for (int m = 0; m < 2; m++) sum += B_BEFORE[i][a][m] * work.change[N + m][c];
#endif
                work.next[a][c] = sum;
            }
        for (int a = 0; a < N + 2; a++)
            memcpy(work.change[a], work.next[a], (size_t)wide * sizeof(real));
        for (int l = 0; l < L; l++)
            for (int b = 0; b < N; b++)
                for (int c = 0; c < wide; c++)
                    work.T[STATES + j * L + l][c] += LIMITED[i][l][b] * work.change[b][c];
    }
    for (int row = 0; row < ROWS; row++) {
        real square = 0;
        for (int a = 0; a < C; a++) square += work.T[row][a] * work.T[row][a];
        work.length[row] = FN(sqrt)(square);
    }
}

static real at(int row, const real c[C]) {
    real sum = work.value[row];
    for (int a = 0; a < C; a++) sum += work.T[row][a] * c[a];
    return sum;
}

/* Compute z, the inward unit normal of a row, orthogonalised against the first n basis vectors, and
 * their coefficients d. Returns the squared norm of z. Two passes reduce rounding errors. */
static real normal(int row, real side, int n, real z[C], real d[C]) {
    real square = 0;
    for (int a = 0; a < C; a++) z[a] = side * work.T[row][a] / work.length[row];
    memset(d, 0, C * sizeof(real));
    for (int pass = 0; pass < 2; pass++)
        for (int j = 0; j < n; j++) {
            real along = 0;
            for (int a = 0; a < C; a++) along += work.basis[j][a] * z[a];
            for (int a = 0; a < C; a++) z[a] -= along * work.basis[j][a];
            d[j] += along;
        }
    for (int a = 0; a < C; a++) square += z[a] * z[a];
    return square;
}

static void extend(int n, const real z[C], const real d[C], real square) {
    const real root = FN(sqrt)(square);
    for (int a = 0; a < C; a++) work.basis[n][a] = z[a] / root;
    for (int j = 0; j < n; j++) work.triangle[j][n] = d[j];
    work.triangle[n][n] = root;
}

/* The dual active-set method for a unit Hessian (D. Goldfarb, A. Idnani, A numerically stable dual
 * method for solving strictly convex quadratic programs, Mathematical Programming 27, 1983): start
 * at the unconstrained optimum, and activate the most violated row until none is violated; a row
 * whose multiplier would become negative is dropped. Returns the number of steps. */
enum { NO_POINT = -1, TOO_LONG = -2 };

static int minimise(real c[C]) {
    int active[C], n = 0, steps = 0;
    real side[C], multiplier[C], z[C], d[C], r[C];
    memset(c, 0, C * sizeof(real));
    for (;;) {
        int worst = -1, drop;
        real broken = TOLERANCE, way = 0, own = 0;
        for (int row = 0; row < ROWS; row++) {
            const real now = at(row, c), under = work.low[row] - now, over = now - work.high[row];
            const real most = under > over ? under : over;
            if (work.length[row] == 0) {
                if (most > UNREACHABLE) return NO_POINT;
            } else if (most > broken * work.length[row]) {
                broken = most / work.length[row];
                worst = row;
                way = under > over ? (real)1 : (real)-1;
            }
        }
        if (worst < 0) return steps;
        do { /* drop active rows until this row can be added */
            const real square = normal(worst, way, n, z, d);
            real reach = FREE, most = FREE, step;
            if (++steps > MAX_STEPS) return TOO_LONG;
            for (int j = n - 1; j >= 0; j--) {
                r[j] = d[j];
                for (int b = j + 1; b < n; b++) r[j] -= work.triangle[j][b] * r[b];
                r[j] /= work.triangle[j][j];
            }
            drop = -1;
            for (int j = 0; j < n; j++)
                if (r[j] > DEPENDENT && multiplier[j] < most * r[j])
                    most = multiplier[j] / r[j], drop = j;
            if (square > DEPENDENT) reach = broken / square;
            if (reach >= FREE && drop < 0) return NO_POINT;
            if (reach <= most) drop = -1;
            step = reach <= most ? reach : most;
            for (int j = 0; j < n; j++) multiplier[j] -= step * r[j];
            own += step;
            if (reach < FREE) {
                for (int a = 0; a < C; a++) c[a] += step * z[a];
                broken -= step * square;
            }
            if (drop < 0) {
                extend(n, z, d, square);
                active[n] = worst, side[n] = way, multiplier[n] = own;
                n++;
            } else {
                n--;
                for (int j = drop; j < n; j++) {
                    active[j] = active[j + 1], side[j] = side[j + 1];
                    multiplier[j] = multiplier[j + 1];
                    extend(j, z, d, normal(active[j], side[j], j, z, d));
                }
            }
        } while (drop >= 0);
    }
}

/* Compute the c that results if the regulator's corrections are clipped to their limits in turn. */
static void clipped_regulator(real c[C]) {
    memset(c, 0, C * sizeof(real));
    for (int j = 0; j < C; j += 2) {
        const real *first = work.T[j] + j, *second = work.T[j + 1] + j;
        const real determinant = first[0] * second[1] - first[1] * second[0];
        real step[2];
        for (int m = 0; m < 2; m++) {
            const real now = at(j + m, c);
            step[m] = clip(now, work.low[j + m], work.high[j + m]) - now;
        }
        if (determinant == 0) continue;
        c[j] = (second[1] * step[0] - first[1] * step[1]) / determinant;
        c[j + 1] = (first[0] * step[1] - second[0] * step[0]) / determinant;
    }
}

/* Compute the corrections of the next H periods. State limits that cannot be kept are widened to the
 * values under the clipped regulator. If the method needs too many steps, the corrections of the
 * last period are kept. */
static void optimise(tracker *self, int k, real state[X]) {
    real c[C];
    self->steps = 0;
    if (roll_out(k, state)) {
        respond(k);
        self->steps = minimise(c);
        if (self->steps < 0) self->fallbacks++;
        if (self->steps == NO_POINT) {
            clipped_regulator(c);
            for (int row = STATES; row < ROWS; row++) {
                const real reached = at(row, c);
                if (reached < work.low[row]) work.low[row] = reached;
                if (reached > work.high[row]) work.high[row] = reached;
            }
            self->steps = minimise(c);
            if (self->steps < 0) clipped_regulator(c);
        } else if (self->steps == TOO_LONG) {
            for (int j = 0; j < C; j++)
                work.value[j] = j < C - 2 ? self->corrections[j / 2 + 1][j % 2] : 0;
            memset(c, 0, sizeof c);
        }
        for (int j = 0; j < C; j++) work.value[j] = at(j, c);
    }
    for (int j = 0; j < C; j++)
        self->corrections[j / 2][j % 2] = clip(work.value[j], work.low[j], work.high[j]);
}

/* -- commands --------------------------------------------------------------------------------------- */

/* Compute the state: deviation from the reference, last corrections, rate errors, lost motion. */
static void state_of(const tracker *self, int k, const tracker_pose *pose, real state[X]) {
    state[0] = pose->q[0] - Q[k][0];
    state[1] = pose->q[1] - Q[k][1];
    for (int m = 0; m < 2; m++) state[N + m] = self->corrections[0][m];
    for (int i = 0; i < P; i++) {
        const real way = WAY[k][i], lost = self->lost_motion[i + 1], then = NEXT_PUSH[k][i];
        const real stays = way * (pose->q[i + 2] - JOINT[k][i]) - positive(PUSH[k][i]);
        const real pushed =
            way * (pose->axis[i + 1] - Q[k][i + 2]) - lost + negative(PUSH[k][i]);
        const real more = lost - COURSE_LOST_MOTION[i] - negative(then) / 2;
        state[i + 2] = way * (stays > pushed ? stays : pushed);
        state[N + 2 + i] = self->rate_error[i + 1];
        state[N + 2 + P + i] = more < positive(then) / 2 ? more : positive(then) / 2;
    }
}

/* Clip commands to the limits on speed and on its change per tick. */
static void limit_commands(const tracker *self, real speed[M][2]) {
    for (int i = 0; i < M; i++)
        for (int m = 0; m < 2; m++) speed[i][m] = clip(speed[i][m], -LIMIT[m], LIMIT[m]);
#if RATED
    for (int m = 0; m < 2; m++) {
        real before = self->ticks ? self->told[(self->ticks - 1) % TRACKER_RING][m] : 0;
        for (int i = 0; i < M; i++) {
            if (self->ticks + i == LAST_TICK[m]) before = 0; /* may stop at once, as in the plan */
            before = clip(speed[i][m], before - RATE[m] * TICK_S, before + RATE[m] * TICK_S);
            speed[i][m] = before;
        }
    }
#else
    (void)self;
#endif
}

/* Let a reversing motor cross its play in one period; hold it if its coming turn is short. */
static void cross_play(const tracker *self, int k, const tracker_pose *pose, real speed[M][2]) {
    const real half[2] = {DRIVE_PLAY / 2, self->lost_motion[0]};
    const real side[2] = {pose->side, pose->axis[0] - pose->q[1]};
    const int ahead = CROSSING_PERIODS < H ? CROSSING_PERIODS : H;
    for (int m = 0; m < 2; m++) {
        real sum = 0, soon = 0;
        for (int i = 0; i < M; i++) sum += speed[i][m];
        for (int j = 0; j < ahead && k + j < K; j++) {
            real feed = 0;
            for (int i = 0; i < M; i++) feed += FEED[k + j][i][m];
            soon += feed / M + self->corrections[j][m];
        }
        const real way = sign(sum), gap = way == 0 ? 0 : half[m] - way * side[m];
        const int worth = way * PERIOD_S * soon > PLAY_SPREAD_SHARE * 2 * half[m];
        for (int i = 0; i < M; i++) {
            if (worth) speed[i][m] += way * gap / PERIOD_S;
            else if (gap > half[m] / 2) speed[i][m] = 0;
        }
    }
}

/* Decide the commands of one period, from the first tick that they can still affect. */
static void decide(tracker *self, int k) {
    const real now[2] = {-SHIFT_TICKS[0], -SHIFT_TICKS[1]};
    const real until[2] = {TRACKER_LATENCY_TICKS, TRACKER_LATENCY_TICKS};
    tracker_pose pose = self->pose;
    real state[X], before[2], speed[M][2];
    forecast(self, &pose, k * M, now, until);
    memcpy(before, self->corrections[0], sizeof before);
    state_of(self, k, &pose, state);
    optimise(self, k, state);
    for (int i = 0; i < M; i++)
        for (int m = 0; m < 2; m++) {
            /* If rates are limited, corrections change linearly from one period to the next. */
            const real share = RATED ? ((real)i + (real)0.5) / M : 1;
            const real change = self->corrections[0][m] - before[m];
            speed[i][m] = FEED[k][i][m] + before[m] + share * change;
        }
    limit_commands(self, speed);
    if (CROSSES_PLAY) cross_play(self, k, &pose, speed);
    limit_commands(self, speed);
    for (int i = 0; i < M; i++) tell(self, speed[i]);
}

/* -- interface -------------------------------------------------------------------------------------- */

void tracker_start(tracker *self) {
    memset(self, 0, sizeof *self);
    memcpy(self->pose.q, START, sizeof START);
    for (int j = 0; j < J; j++) {
        const real lost = MEAN_LOST_MOTION[j], spread = LOST_SPREAD * lost;
        self->pose.axis[j] = self->rest[j] = START[j + 1];
        self->rest_variance[j] = NOISE[j] > 0 ? UNKNOWN_VARIANCE : 0;
        self->lost_motion[j] = lost;
        self->covariance[j][0][0] = READING_VARIANCE[j] + spread * spread;
        self->covariance[j][1][1] = spread * spread;
        self->covariance[j][2][2] = RATE_SPREAD * RATE_SPREAD;
        self->is_pushed[j] = lost == 0;
    }
    for (int i = 0; i < TRACKER_LATENCY_TICKS; i++) tell(self, FIRST[i]);
}

/* Note the first joint whose mean reading leaves the band that 95 % of the machines keep. */
static void watch(tracker *self, int k, int j, real seen) {
    if (!isfinite(seen)) return;
    self->off[j] += MEAN_SHARE * (seen - MIDDLE[k][j] - self->off[j]);
    if (!self->outside && FN(fabs)(self->off[j]) > BAND[k][j]) self->outside = j + 1;
}

tracker_status tracker_read(tracker *self, const tracker_real measured[TRACKER_COORDINATES]) {
    const int k = self->period;
    if (k >= K) return TRACKER_OVER;
    if (k) {
        const real now[2] = {-SHIFT_TICKS[0], -SHIFT_TICKS[1]};
        const real before[2] = {now[0] - M, now[1] - M};
        tracker_pose pose = self->pose;
        forecast(self, &pose, k * M, before, now);
        take_forecast(self, &pose);
    }
    for (int j = 0; j < J; j++) {
        read_joint(self, j, measured[j + 1]);
        watch(self, k, j, measured[j + 1]);
    }
    if (isfinite(measured[0]))
        self->pose.q[0] =
            clip(self->pose.q[0], measured[0] - HALF_STEP[0], measured[0] + HALF_STEP[0]);
    decide(self, k);
    self->period++;
    return TRACKER_RUNS;
}

tracker_status tracker_command(const tracker *self, int tick, tracker_real speed[2]) {
    const int known = tick >= 0 && tick < self->ticks && tick >= self->ticks - TRACKER_RING;
    for (int m = 0; m < 2; m++) speed[m] = known ? self->told[tick % TRACKER_RING][m] : 0;
    if (tick >= K * M + TRACKER_LATENCY_TICKS) return TRACKER_OVER;
    return known ? TRACKER_RUNS : TRACKER_LATE;
}
