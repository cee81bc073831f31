/* For each line of link angles and velocities, torques, force and voltages: the observation on the way along a path. */

#include <stdio.h>

#include "pter.h"

int main(void)
{
    pter_state state;
    pter_reading r;
    pter_path path = {pter_path_arcs, PTER_ARCS, 0.25};
    float *v = state.volts, observation[PTER_ENTRIES];
    pter_reset(&state);
    while (scanf("%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%f,%f,%f,%f", r.angle, r.angle + 1, r.velocity,
                 r.velocity + 1, r.torque, r.torque + 1, r.torque + 2, r.torque + 3, r.force, r.force + 1, v, v + 1,
                 v + 2, v + 3) == 14) {
        pter_observe(&state, &r, &path, observation);
        for (int k = 0; k < PTER_ENTRIES; k++) {
            printf("%.9g%s", observation[k], k == PTER_ENTRIES - 1 ? "\n" : ",");
        }
    }
    return 0;
}
