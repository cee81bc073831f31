/* A policy as a filter: for each line of an observation on standard input, numbers separated by commas, a line
   of voltages on standard output. An empty line begins an episode. */

#include <stdio.h>
#include <stdlib.h>

#include "pter.h"

int main(void)
{
    static char line[PTER_ENTRIES * 32 + 2];
    pter_state state;
    float observation[PTER_ENTRIES], volts[4];
    pter_reset(&state);
    while (fgets(line, sizeof line, stdin)) {
        char *at = line, *end = line;
        if (*line == '\n' || *line == '\r') {
            pter_reset(&state);
            continue;
        }
        for (int k = 0; k < PTER_ENTRIES; k++) {
            observation[k] = strtof(at, &end);
            if (end == at) {
                fprintf(stderr, "a line must hold %d numbers\n", PTER_ENTRIES);
                return 1;
            }
            at = *end == ',' ? end + 1 : end;
        }
        pter_act(&state, observation, volts);
        printf("%.9g,%.9g,%.9g,%.9g\n", volts[0], volts[1], volts[2], volts[3]);
        fflush(stdout);
    }
    return 0;
}
