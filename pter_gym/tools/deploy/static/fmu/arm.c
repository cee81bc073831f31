/* An episode with the arm, and with a policy if there is one: the module's functions on a memory of their own. */

#include "model.h"

#include <stdbool.h>
#include <string.h>

#include "arm_data.h"
#include "module.h"

/* A model begins with the module's global variables; its memory begins behind them. */
#define MEMORY MODEL_ALIGNMENT

const size_t MODEL_MEMORY = MEMORY + AT_END, MODEL_STATE = MEMORY + AT_WORLD, MODEL_STATE_SIZE = AT_END - AT_WORLD;

static double get(const unsigned char *memory, size_t at, size_t k)
{
    double value;
    memcpy(&value, memory + at + k * sizeof value, sizeof value);
    return value;
}

static void put(unsigned char *memory, size_t at, size_t k, double value)
{
    memcpy(memory + at + k * sizeof value, &value, sizeof value);
}

static void scale(unsigned char *memory, size_t place, double by)
{
    put(memory, AT_CONTEXT, place, by * get(memory, AT_CONTEXT, place));
}

/* Write what is seen of the arm. */
static void write_outputs(const unsigned char *memory, double numbers[])
{
    memcpy(numbers + TELEMETRY, memory + AT_TELEMETRY, TELEMETRY_COUNT * sizeof(double));
    for (size_t k = 0; k < ENTRIES; k++) {
        float entry;
        memcpy(&entry, memory + AT_OBSERVATION + k * sizeof entry, sizeof entry);
        numbers[OBSERVATION + k] = (double)entry * observation_scales[k];
    }
}

void model_prepare(unsigned char *model)
{
    unsigned char *memory = model + MEMORY;
    kernels_prepare(memory);
    memcpy(memory + AT_CONFIG, config, sizeof config);
    memcpy(memory + AT_CONSTANTS, constants, sizeof constants);
#if HAS_POLICY
    memcpy(memory + AT_SCALES, observation_scales, SEEN * sizeof(double));
    memcpy(memory + AT_GAINS, gains, sizeof gains);
#endif
}

/* Change the episode's constants as the parameters say. */
static void set_parameters(unsigned char *memory, const double numbers[])
{
    double pace = get(memory, AT_CONTEXT, CONTEXT_PACE), by = numbers[PACE] / pace;
    put(memory, AT_CONTEXT, CONTEXT_PACE, numbers[PACE]);
    if (by != 1.0)
        scale(memory, CONTEXT_INTENT_SPEED, by);
    for (size_t k = 0; k < 4; k++) {
        scale(memory, CONTEXT_SCALE + k, numbers[STRENGTH + k]);
        scale(memory, CONTEXT_VISCOUS + k, numbers[STRENGTH + k]);
    }
    put(memory, AT_CONTEXT, CONTEXT_PUSH, get(memory, AT_CONTEXT, CONTEXT_PUSH) + numbers[MORE_PUSH]);
#if HAS_FORCE
    put(memory, AT_CONTEXT, CONTEXT_RECORD_FIRST, FORCES_INDEX);
#endif
}

void model_begin(unsigned char *model, double numbers[], const int32_t integers[])
{
    unsigned char *memory = model + MEMORY;
    size_t episode = (size_t)integers[EPISODE];
    uint64_t words[2] = {integers[SEED] < 0 ? seeds[episode] : (uint64_t)integers[SEED], 0};
    memset(memory + AT_WORLD, 0, AT_END - AT_WORLD);
    memcpy(memory + AT_WORDS, words, sizeof words);
    memcpy(memory + AT_CONTEXT, constants + contexts[episode], CONTEXT_WIDTH * sizeof(double));
    set_parameters(memory, numbers);
    put(memory, AT_WORLD, ROW_DRAWS_FROM, CONTEXT_INDEX);
    put(memory, AT_WORLD, ROW_DRAWS, 1.0);
    kernels_reset(memory, AT_WORLD, AT_WORDS, AT_OBSERVATION, ENTRIES, AT_TELEMETRY, AT_CONFIG, AT_CONSTANTS);
#if HAS_POLICY && LAW_EPISODE >= 0
    put(memory, AT_MEMORY, LAW_EPISODE, (double)(words[0] % (UINT64_C(1) << 53)));
#endif
    write_outputs(memory, numbers);
}

void model_look(unsigned char *model, double numbers[])
{
    (void)model, (void)numbers;
}

#if HAS_FORCE
/* Let the hand's force come to that of the inputs at the end of the control step, along and across the path. */
static void push(unsigned char *memory, const double numbers[])
{
    double cosine = get(memory, AT_WORLD, ROW_HEADING_COS), sine = get(memory, AT_WORLD, ROW_HEADING_SIN);
    double x = numbers[FORCE], y = numbers[FORCE + 1], step = get(memory, AT_WORLD, ROW_STEP);
    double along = x * cosine + y * sine, across = y * cosine - x * sine;
    memmove(memory + AT_FORCES, memory + AT_FORCES + 2 * sizeof(double), 2 * sizeof(double));
    put(memory, AT_FORCES, 2, along);
    put(memory, AT_FORCES, 3, across);
    put(memory, AT_WORLD, ROW_RECORD_FIRST, FORCES_INDEX - 2.0 * step);
    put(memory, AT_WORLD, ROW_RECORD_COUNT, step + 2.0);
}
#endif

#if HAS_POLICY
/* Let the policy decide, or keep to what it has decided. */
static void act(unsigned char *memory)
{
    double held = get(memory, AT_HELD, 0);
    if (held == 0.0) {
        kernels_act(memory, AT_OBSERVATION, SEEN, AT_SCALES, AT_GAINS, sizeof gains / sizeof *gains, AT_MEMORY,
                    LAW_MEMORY, AT_VOLTS);
        for (size_t k = 0; k < 4; k++) {
            double volts = (double)(float)get(memory, AT_VOLTS, k);
            put(memory, AT_VOLTS, k, volts > 0.0 ? volts < VOLTAGE_MAX ? volts : VOLTAGE_MAX : 0.0);
        }
    }
    put(memory, AT_HELD, 0, held + 1.0 < HOLD ? held + 1.0 : 0.0);
}
#endif

int model_step(unsigned char *model, double numbers[])
{
    unsigned char *memory = model + MEMORY;
#if HAS_FORCE
    push(memory, numbers);
#endif
#if HAS_POLICY
    act(memory);
#else
    memcpy(memory + AT_VOLTS, numbers + VOLTS, 4 * sizeof(double));
#endif
    kernels_step(memory, AT_WORLD, AT_WORDS, AT_OBSERVATION, ENTRIES, AT_TELEMETRY, AT_CONFIG, AT_CONSTANTS,
                 AT_VOLTS, GUIDES);
    write_outputs(memory, numbers);
    return get(memory, AT_WORLD, ROW_ALIVE) != 0.0;
}
