/* $title

   Made by pter_gym; a change here is lost when it is made again. C99, without heap, libraries or anything
   global that changes: several states may be used at once. One control step is

       pter_encoder, twice;  pter_observe;  pter_act;  the voltages go to the amplifiers.

   Observation: $entries float32 numbers, each over its scale:
$observation */

#ifndef PTER_H
#define PTER_H

#include <stdint.h>

#define PTER_DIGEST 0x$digest /* of this policy: pter.c checks that it is its own */
#define PTER_PERIOD ((pter_real)$period) /* of a control step [s] */
#define PTER_ENTRIES $entries /* numbers in an observation */
#define PTER_HOLD $hold /* control steps for which an action is held */
#define PTER_VOLTAGE_MAX ((pter_real)$top) /* largest voltage [V] */
#define PTER_MEMORY $memory /* numbers that the law keeps */
#define PTER_ARCS $arcs /* arcs of pter_path_arcs */

#ifdef __cplusplus
extern "C" {
#endif

typedef $real pter_real;

/* What lasts from one control step to the next. */
typedef struct {
    pter_real memory[PTER_MEMORY];
    float volts[4];
    int32_t held, arc;
} pter_state;

/* The sensors: angles of links A and B [rad] and angular velocities [rad/s]; torques that the clutches
   generate [N m] and the hand's force along and across the path [N], zero where nothing measures them. */
typedef struct {
    pter_real angle[2], velocity[2], torque[4], force[2];
} pter_reading;

/* The path, an array of arcs like pter_path_arcs and their number, and the commanded pace [m/s]. An arc is x, y [m], cosine and
   sine of the heading, curvature [1/m], arc length before it and its own [m]. */
typedef struct {
    const pter_real *arcs;
    int32_t count;
    pter_real pace;
} pter_path;

/* The path with which this file was made. */
extern const pter_real pter_path_arcs[PTER_ARCS * 7];

/* Begin an episode. */
void pter_reset(pter_state *state);

/* Return the unwrapped count of a counter of so many bits, given the count before. */
int32_t pter_count(int32_t before, uint32_t counter, int bits);

/* Set angle and angular velocity of link A (0) or B (1) from its encoder: counts now and a control step ago,
   which must not wrap (see pter_count), the angle of one count and that of count 0 [rad]. */
void pter_encoder(pter_reading *reading, int link, int32_t count, int32_t before, pter_real resolution,
                  pter_real zero);

/* Write the observation at a control step; all of it is NaN if anything in the reading is NaN, an angle is
   beyond a million radians, or the path has no arc. */
void pter_observe(pter_state *state, const pter_reading *reading, const pter_path *path,
                  float observation[PTER_ENTRIES]);

/* Write the voltages of the four clutches [V] at a control step, from 0 to PTER_VOLTAGE_MAX. If anything in the
   observation is NaN, they are 0, the memory does not change, and the next step computes new voltages. */
void pter_act(pter_state *state, const float observation[PTER_ENTRIES], float volts[4]);

#ifdef __cplusplus
}
#endif

#endif
