/* Feeds recorded readings to the tracker and compares its commands with the expected ones, those of
 * the same tracker in Python. Ends with 0 if they agree in all but ODD_PERIODS periods. */
#include <math.h>
#include <stdio.h>

#include "recording.h"
#include "tracker.h"

int main(void) {
    static tracker arm;
    double worst = 0;
    int hardest = 0, ticks = 0, odd = 0;
    tracker_start(&arm);
    for (int k = 0; k < READINGS; k++) {
        double most = 0;
        tracker_read(&arm, MEASURED[k]);
        if (arm.steps > hardest) hardest = arm.steps;
        for (int i = 0; i < TRACKER_TICKS; i++) {
            tracker_real speed[2];
            if (tracker_command(&arm, ticks++, speed) == TRACKER_LATE) most = HUGE_VAL;
            for (int m = 0; m < 2; m++) {
                const double off = fabs((double)speed[m] - EXPECTED[k][i][m]);
                if (!(off <= most)) most = off;
            }
        }
        if (!(most <= ALLOWED)) odd++;
        if (!(most <= worst)) worst = most;
    }
    printf("%d readings: commands differ by at most %.2g, by more than %.2g in %d periods (allowed: %d)\n"
           "most steps of a period: %d; fallbacks: %d; a tracker has %u bytes\n",
           READINGS, worst, ALLOWED, odd, ODD_PERIODS, hardest, arm.fallbacks, (unsigned)sizeof arm);
    return odd <= ODD_PERIODS ? 0 : 1;
}
