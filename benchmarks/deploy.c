/* What a policy in C costs. On a computer: the time of a control step for observations on standard input, float32.
   On a microcontroller: a program that calls everything once, for its size. */

#include "pter.h"

#if __STDC_HOSTED__

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { ROWS = 1000, TURNS = 30 };

static float rows[ROWS][PTER_ENTRIES];
static double best[ROWS];

static int rising(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(void)
{
    static pter_state state;
    size_t count = fread(rows, sizeof rows[0], ROWS, stdin);
    for (int turn = 0; turn < TURNS; turn++) {
        pter_reset(&state);
        for (size_t k = 0; k < count; k++) {
            struct timespec begin, end;
            float volts[4];
            clock_gettime(CLOCK_MONOTONIC, &begin);
            pter_act(&state, rows[k], volts);
            clock_gettime(CLOCK_MONOTONIC, &end);
            double time = 1e9 * (end.tv_sec - begin.tv_sec) + (end.tv_nsec - begin.tv_nsec);
            best[k] = turn == 0 || time < best[k] ? time : best[k];
        }
    }
    qsort(best, count, sizeof best[0], rising);
    printf("%.0f %.0f\n", best[count / 2], best[count - 1]);
    return 0;
}

#else

static pter_state state;
static volatile float pins[PTER_ENTRIES];

void _start(void)
{
    pter_reading reading = {0};
    pter_path path = {pter_path_arcs, PTER_ARCS, pins[0]};
    float observation[PTER_ENTRIES], volts[4];
    pter_reset(&state);
    pter_encoder(&reading, 0, (int)pins[1], (int)pins[2], pins[3], pins[4]);
    pter_encoder(&reading, 1, (int)pins[5], (int)pins[6], pins[7], pins[8]);
    pter_observe(&state, &reading, &path, observation);
    pter_act(&state, observation, volts);
    for (int k = 0; k < 4; k++) {
        pins[k] = volts[k];
    }
}

#endif
