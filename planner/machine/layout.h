/* What Python hands over. Written from the tables of compiled.py by `make generated`. */

#ifndef LAYOUT_H
#define LAYOUT_H

#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#ifdef _MSC_VER
#define INLINE static __forceinline
#else
#define INLINE static inline __attribute__((always_inline))
#endif

#define VERSION 2450734339
#define MOTORS 2
#define JOINTS 16 /* passive ones, at most; of the following as many as then */
#define BODIES 52
#define LIMITED 68
#define PLAYS 18
#define LAWS 86
#define STATE 128

typedef struct {
    int64_t samples, joints, points, steps, rows, lagging, second, limited, ramped, geared_1, geared_2, lagged, soft, damped, creeping, loaded, inclined, dynamic, coordinates, heavy;
    double k_g, gamma;
    const double *parameters;
    const double *length;
    const uint8_t *running;
    const double *desired;
    const int64_t *row;
    double *state;
    double *q;
    double *speed;
    const double *masses;
    double *moving;
} Model;


typedef struct {
    const double *value;
    int64_t step, point, motor, sample;
} Commands;


typedef struct {
    const double *control_period_s; /* 1 */
    const double *delay_s; /* 1 */
    const double *velocity_resolution_rad_s; /* 2 */
    const double *input_gain_error; /* 2 */
    const double *input_bias_rad_s; /* 2 */
    const double *velocity_limit_rad_s; /* 2 */
    const double *acceleration_limit_rad_s2; /* 2 */
    const double *servo_bandwidth_rad_s; /* 2 */
    const double *servo_damping; /* 2 */
    const double *creep; /* 1 */
    const double *creep_per_nm; /* 1 */
    const double *lateral_friction; /* 1 */
    const double *friction_capacity_nm; /* 1 */
    const double *gear_ratio_error; /* m */
    const double *gearhead_backlash_deg; /* 2 */
    const double *backlash_deg; /* m */
    const double *initial_play; /* m */
    const double *shaft_stiffness_nm_per_rad; /* m */
    const double *coulomb_friction_nm; /* m */
    const double *viscous_friction_nms_per_rad; /* m */
    const double *incline_deg; /* 1 */
    const double *link_moment_kgm; /* 1 + m */
    const double *initial_angle_error_deg; /* 1 + m */
    const double *encoder_noise_deg; /* 1 + m */
    const double *encoder_resolution_deg; /* 1 + m */
    const double *gain; /* 2 */
    const double *gearhead_half; /* 2 */
    const double *k; /* m */
    const double *half_gap; /* m */
    const double *rest; /* m */
    const double *weights; /* 1 + m */
} Own;

INLINE Own own(const double *at, int64_t m, int64_t w)
{
    Own out;
    out.control_period_s = at + (0) * w;
    out.delay_s = at + (1) * w;
    out.velocity_resolution_rad_s = at + (2) * w;
    out.input_gain_error = at + (4) * w;
    out.input_bias_rad_s = at + (6) * w;
    out.velocity_limit_rad_s = at + (8) * w;
    out.acceleration_limit_rad_s2 = at + (10) * w;
    out.servo_bandwidth_rad_s = at + (12) * w;
    out.servo_damping = at + (14) * w;
    out.creep = at + (16) * w;
    out.creep_per_nm = at + (17) * w;
    out.lateral_friction = at + (18) * w;
    out.friction_capacity_nm = at + (19) * w;
    out.gear_ratio_error = at + (20) * w;
    out.gearhead_backlash_deg = at + (20 + m) * w;
    out.backlash_deg = at + (22 + m) * w;
    out.initial_play = at + (22 + 2 * m) * w;
    out.shaft_stiffness_nm_per_rad = at + (22 + 3 * m) * w;
    out.coulomb_friction_nm = at + (22 + 4 * m) * w;
    out.viscous_friction_nms_per_rad = at + (22 + 5 * m) * w;
    out.incline_deg = at + (22 + 6 * m) * w;
    out.link_moment_kgm = at + (23 + 6 * m) * w;
    out.initial_angle_error_deg = at + (24 + 7 * m) * w;
    out.encoder_noise_deg = at + (25 + 8 * m) * w;
    out.encoder_resolution_deg = at + (26 + 9 * m) * w;
    out.gain = at + (27 + 10 * m) * w;
    out.gearhead_half = at + (29 + 10 * m) * w;
    out.k = at + (31 + 10 * m) * w;
    out.half_gap = at + (31 + 11 * m) * w;
    out.rest = at + (31 + 12 * m) * w;
    out.weights = at + (31 + 13 * m) * w;
    return out;
}

INLINE int64_t own_count(int64_t m) { return 32 + 14 * m; }

typedef struct {
    double *speed; /* 2 */
    double *slope; /* 2 */
    double *saturated; /* 2 */
    double *slip; /* 3 */
    double *disk; /* 2 */
    double *first; /* 1 */
    double *theta; /* 1 + m */
    double *axis; /* 1 + m */
    double *wound; /* 1 + m */
    double *gap; /* 1 + m */
} Held;

INLINE Held held(double *at, int64_t m, int64_t w)
{
    Held out;
    out.speed = at + (0) * w;
    out.slope = at + (2) * w;
    out.saturated = at + (4) * w;
    out.slip = at + (6) * w;
    out.disk = at + (9) * w;
    out.first = at + (11) * w;
    out.theta = at + (12) * w;
    out.axis = at + (13 + m) * w;
    out.wound = at + (14 + 2 * m) * w;
    out.gap = at + (15 + 3 * m) * w;
    return out;
}

INLINE int64_t held_count(int64_t m) { return 16 + 4 * m; }

typedef struct {
    double *y; /* 16 + 7 * m */
    double *pieces; /* 6 + 5 * m */
    double *gained; /* 1 + 2 * m */
    double *energy; /* 2 */
    double *slipping; /* 1 */
    double *last; /* 1 */
} Moving;

INLINE Moving moving(double *at, int64_t m, int64_t w)
{
    Moving out;
    out.y = at + (0) * w;
    out.pieces = at + (16 + 7 * m) * w;
    out.gained = at + (22 + 12 * m) * w;
    out.energy = at + (23 + 14 * m) * w;
    out.slipping = at + (25 + 14 * m) * w;
    out.last = at + (26 + 14 * m) * w;
    return out;
}

INLINE int64_t moving_count(int64_t m) { return 27 + 14 * m; }

typedef struct {
    double inertia[52];
    double gain[2];
    double integral[2];
    double limit[2];
    double stiffness[18];
    double damping[18];
    double half_gap[18];
    double coulomb[17];
    double viscous[16];
    double k[16];
    double disk[16];
    double kept[1];
    double creep[1];
    double capacity[1];
    double lateral[1];
    double weights[17];
    double lengths[17];
    double moments[17];
} Masses;

INLINE Masses masses_of(int m, const double *from, int64_t samples)
{
    Masses p;
    for (int i = 0; i < 4 + 3 * m; i++)
        p.inertia[i] = from[(0 + i) * samples];
    for (int i = 0; i < 2; i++)
        p.gain[i] = from[(4 + 3 * m + i) * samples];
    for (int i = 0; i < 2; i++)
        p.integral[i] = from[(6 + 3 * m + i) * samples];
    for (int i = 0; i < 2; i++)
        p.limit[i] = from[(8 + 3 * m + i) * samples];
    for (int i = 0; i < 2 + m; i++)
        p.stiffness[i] = from[(10 + 3 * m + i) * samples];
    for (int i = 0; i < 2 + m; i++)
        p.damping[i] = from[(12 + 4 * m + i) * samples];
    for (int i = 0; i < 2 + m; i++)
        p.half_gap[i] = from[(14 + 5 * m + i) * samples];
    for (int i = 0; i < 1 + m; i++)
        p.coulomb[i] = from[(16 + 6 * m + i) * samples];
    for (int i = 0; i < m; i++)
        p.viscous[i] = from[(17 + 7 * m + i) * samples];
    for (int i = 0; i < m; i++)
        p.k[i] = from[(17 + 8 * m + i) * samples];
    for (int i = 0; i < m; i++)
        p.disk[i] = from[(17 + 9 * m + i) * samples];
    for (int i = 0; i < 1; i++)
        p.kept[i] = from[(17 + 10 * m + i) * samples];
    for (int i = 0; i < 1; i++)
        p.creep[i] = from[(18 + 10 * m + i) * samples];
    for (int i = 0; i < 1; i++)
        p.capacity[i] = from[(19 + 10 * m + i) * samples];
    for (int i = 0; i < 1; i++)
        p.lateral[i] = from[(20 + 10 * m + i) * samples];
    for (int i = 0; i < 1 + m; i++)
        p.weights[i] = from[(21 + 10 * m + i) * samples];
    for (int i = 0; i < 1 + m; i++)
        p.lengths[i] = from[(22 + 11 * m + i) * samples];
    for (int i = 0; i < 1 + m; i++)
        p.moments[i] = from[(23 + 12 * m + i) * samples];
    return p;
}

typedef struct {
    int m, axes, disk, links, stages, bodies, behind, twist, gap, reference, q, torque, count, limited, plays;
} Rows;

INLINE Rows rows_of(int m)
{
    Rows r;
    r.m = m;
    r.axes = 2;
    r.disk = 2 + m;
    r.links = 3 + m;
    r.stages = 4 + 2 * m;
    r.bodies = 4 + 3 * m;
    r.behind = 4 + 3 * m;
    r.twist = 6 + 3 * m;
    r.gap = 8 + 4 * m;
    r.reference = 10 + 5 * m;
    r.q = 12 + 5 * m;
    r.torque = 14 + 6 * m;
    r.count = 16 + 7 * m;
    r.limited = 4 + 4 * m;
    r.plays = 2 + m;
    return r;
}

#endif
