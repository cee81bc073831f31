/* A policy alone: what the sensors read goes in, voltages come out. */

#include "model.h"

#include <string.h>

#include "policy_data.h"
#include "pter.h"

/* What a control step ends with: the policy before it, as long as the readings of this instant may change. */
typedef struct {
    pter_state before, now;
} Policy;

const size_t MODEL_MEMORY = sizeof(Policy), MODEL_STATE = 0, MODEL_STATE_SIZE = sizeof(Policy);

void model_prepare(unsigned char *model)
{
    memset(model, 0, sizeof(Policy));
}

void model_begin(unsigned char *model, double numbers[], const int32_t integers[])
{
    Policy *policy = (Policy *)(void *)model;
    (void)integers;
    memset(policy, 0, sizeof *policy);
    pter_reset(&policy->before);
    model_look(model, numbers);
}

void model_look(unsigned char *model, double numbers[])
{
    Policy *policy = (Policy *)(void *)model;
    pter_path path = {pter_path_arcs, PTER_ARCS, numbers[PACE]};
    pter_reading reading;
    float observation[PTER_ENTRIES], volts[4];
    for (int k = 0; k < 2; k++) {
        reading.angle[k] = numbers[ANGLE + k];
        reading.velocity[k] = numbers[VELOCITY + k];
        reading.force[k] = numbers[FORCE + k];
    }
    for (int k = 0; k < 4; k++)
        reading.torque[k] = numbers[TORQUE + k];
    policy->now = policy->before;
    pter_observe(&policy->now, &reading, &path, observation);
    pter_act(&policy->now, observation, volts);
    for (int k = 0; k < 4; k++)
        numbers[VOLTS + k] = volts[k];
}

int model_step(unsigned char *model, double numbers[])
{
    Policy *policy = (Policy *)(void *)model;
    model_look(model, numbers);
    policy->before = policy->now;
    return 1;
}
