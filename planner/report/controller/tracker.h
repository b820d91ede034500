/* A controller that follows one plan on one machine; README.md says what to call when.
 *
 * sizes.h and tables.h hold the plan. C99, no heap; libm is all it needs. */
#ifndef TRACKER_H
#define TRACKER_H

#include "sizes.h"

/* Where the arm is: coordinates, axes of the joints on the same scale (that of joint 1 is motor
 * 2's), and where in the play of its gearhead motor 1 stands. rad. */
typedef struct {
    tracker_real q[TRACKER_COORDINATES], axis[TRACKER_COORDINATES - 1], side;
} tracker_pose;

/* What is known of the arm, and what its motors were told. */
typedef struct {
    tracker_pose pose;
    tracker_real lost_motion[TRACKER_COORDINATES - 1], rate_error[TRACKER_COORDINATES - 1];
    tracker_real covariance[TRACKER_COORDINATES - 1][3][3];
    tracker_real way[TRACKER_COORDINATES - 1], last_turn[TRACKER_COORDINATES - 1];
    tracker_real settling[TRACKER_COORDINATES - 1], last_reading[TRACKER_COORDINATES - 1];
    int is_pushed[TRACKER_COORDINATES - 1];
    tracker_real corrections[TRACKER_HORIZON][2];
    tracker_real told[TRACKER_RING][2], travel[TRACKER_RING][2];
    int period, ticks;  /* readings so far; ticks whose commands are known */
    int fallbacks;      /* periods whose correction could not be optimised as intended */
    int steps;          /* of the active-set method in the last period; 0: no limit was in the way */
} tracker;

typedef enum { TRACKER_RUNS, TRACKER_LATE, TRACKER_OVER } tracker_status;

/* Begin: the arm rests where the plan starts. */
void tracker_start(tracker *self);

/* Take in a reading, one every TRACKER_PERIOD_S from the start on, in the order and the units that
 * README.md states. What is NaN or infinite counts as lost. Of a reading that was missed as a whole
 * every number is NaN. TRACKER_OVER once nothing is left to decide. */
tracker_status tracker_read(tracker *self, const tracker_real measured[TRACKER_COORDINATES]);

/* The speeds of both motors for the tick of this number, counted from the first reading on. Known
 * are the ticks of the period that the last reading began, and TRACKER_LATENCY_TICKS more. Zero if
 * the tick is not known yet (TRACKER_LATE: a reading is overdue), forgotten, or after the end
 * (TRACKER_OVER). */
tracker_status tracker_command(const tracker *self, int tick, tracker_real speed[2]);

#endif
