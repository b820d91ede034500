/* A controller that follows one plan on one machine; README.md explains when to call what.
 *
 * sizes.h and tables.h contain the plan. It is C99, uses no heap, and needs only libm. */
#ifndef TRACKER_H
#define TRACKER_H

#include "sizes.h"

/* Pose of the arm, rad: its coordinates; angles of the axes that drive the joints, on the scale of
 * the joints (the axis of joint 1 is motor 2's); position of motor 1 in its gearhead's play. */
typedef struct {
    tracker_real q[TRACKER_COORDINATES], axis[TRACKER_COORDINATES - 1], side;
} tracker_pose;

/* The estimated state of the arm, and the commands that its motors were given. */
typedef struct {
    tracker_pose pose;
    tracker_real lost_motion[TRACKER_COORDINATES - 1], rate_error[TRACKER_COORDINATES - 1];
    tracker_real covariance[TRACKER_COORDINATES - 1][3][3];
    tracker_real way[TRACKER_COORDINATES - 1], last_turn[TRACKER_COORDINATES - 1];
    tracker_real settling[TRACKER_COORDINATES - 1];
    /* of a resting joint: mean of its readings (without noise the last), and its variance */
    tracker_real rest[TRACKER_COORDINATES - 1], rest_variance[TRACKER_COORDINATES - 1];
    int is_pushed[TRACKER_COORDINATES - 1], jumped[TRACKER_COORDINATES - 1];
    tracker_real corrections[TRACKER_HORIZON][2];
    tracker_real told[TRACKER_RING][2], travel[TRACKER_RING][2];
    int period, ticks;  /* readings so far; ticks whose commands are known */
    tracker_real off[TRACKER_COORDINATES - 1];  /* mean readings minus the middle of their band */
    int outside;        /* the joint, from 1, that first left the band of 95 % of the machines; or 0 */
    int fallbacks;      /* periods whose correction could not be optimised as intended */
    int steps;          /* of the active-set method in the last period; 0: no limit was active */
} tracker;

typedef enum { TRACKER_RUNS, TRACKER_LATE, TRACKER_OVER } tracker_status;

/* Start the tracker. The arm must be at rest where the plan starts. */
void tracker_start(tracker *self);

/* Process a reading, one every TRACKER_PERIOD_S from the start on, in the order and the units that
 * README.md states. A number that is NaN or infinite counts as lost; if a whole reading is missed,
 * pass NaN for every number. Returns TRACKER_OVER when all commands have been decided. */
tracker_status tracker_read(tracker *self, const tracker_real measured[TRACKER_COORDINATES]);

/* Get the speeds of both motors for a tick, counted from the first reading on. They are known for
 * the period that began with the last reading, and for TRACKER_LATENCY_TICKS more. They are zero if
 * they are not known yet or no longer stored (TRACKER_LATE; a reading may be overdue), and after
 * the end (TRACKER_OVER). */
tracker_status tracker_command(const tracker *self, int tick, tracker_real speed[2]);

#endif
