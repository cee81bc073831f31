#include "instance.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { INPUT, PARAMETER, OUTPUT };

#include "variables.h"

#define LONGEST 20000 /* control steps in a communication step */
#define TOLERANCE 1e-6 /* in control periods */

typedef struct {
    uint64_t digest;
    State state;
} Saved;

static Status say(const Instance *instance, Status status, const char *form, ...)
{
    char text[400];
    va_list given;
    va_start(given, form);
    vsnprintf(text, sizeof text, form, given);
    va_end(given);
    if (instance->logger && (instance->is_logging || status >= WARNING))
        instance->tell(instance, status, text);
    return status;
}

static void start(Instance *instance)
{
    memset(&instance->state, 0, sizeof instance->state);
    memcpy(instance->state.numbers, start_numbers, sizeof start_numbers);
    memcpy(instance->state.integers, start_integers, sizeof start_integers);
}

Instance *instance_new(const char *name, const char *token, void *environment, void (*logger)(void),
                       void (*tell)(const Instance *, Status, const char *), bool is_logging)
{
    Instance *instance = calloc(1, sizeof *instance);
    const char *called = name ? name : "";
    if (!instance)
        return NULL;
    instance->environment = environment;
    instance->logger = logger;
    instance->tell = tell;
    instance->is_logging = is_logging;
    instance->name = malloc(strlen(called) + 1);
    if (instance->name)
        strcpy(instance->name, called);
    if (!token || strcmp(token, TOKEN)) {
        say(instance, ERROR, "the token must be that of the description, %s, got %s", TOKEN, token ? token : "none");
        instance_free(instance);
        return NULL;
    }
    instance->allocated = calloc(1, MODEL_MEMORY + MODEL_ALIGNMENT);
    if (!instance->allocated || !instance->name) {
        say(instance, ERROR, "there is not enough memory");
        instance_free(instance);
        return NULL;
    }
    instance->memory = instance->allocated + MODEL_ALIGNMENT - (uintptr_t)instance->allocated % MODEL_ALIGNMENT;
    model_prepare(instance->memory);
    start(instance);
    return instance;
}

void instance_free(Instance *instance)
{
    if (!instance)
        return;
    free(instance->allocated);
    free(instance->name);
    free(instance);
}

Status instance_reset(Instance *instance)
{
    start(instance);
    return OK;
}

Status instance_begin(Instance *instance, double begin)
{
    if (instance->state.phase != INSTANTIATED)
        return say(instance, ERROR, "an initialisation begins once, after the instantiation or a reset");
    if (!isfinite(begin))
        return say(instance, ERROR, "the start time must be finite, got %g", begin);
    instance->state.start = begin;
    instance->state.phase = INITIALISING;
    return OK;
}

/* Make the outputs those of the inputs and, before the simulation, of the parameters. */
static void look(Instance *instance)
{
    State *state = &instance->state;
    if (state->is_current)
        return;
    if (state->phase == INITIALISING)
        model_begin(instance->memory, state->numbers, state->integers);
    else
        model_look(instance->memory, state->numbers);
    state->is_current = 1;
}

Status instance_initialised(Instance *instance)
{
    if (instance->state.phase != INITIALISING)
        return say(instance, ERROR, "no initialisation has begun");
    look(instance);
    instance->state.phase = STEPPING;
    return OK;
}

Status instance_terminate(Instance *instance)
{
    if (instance->state.phase != STEPPING)
        return say(instance, ERROR, "a simulation ends after it has begun");
    instance->state.phase = TERMINATED;
    return OK;
}

/* Return whether a variable can be set now; say why not. */
static bool is_settable(const Instance *instance, const char *name, int kind)
{
    if (kind == OUTPUT)
        say(instance, ERROR, "%s is an output, which cannot be set", name);
    else if (instance->state.phase == TERMINATED)
        say(instance, ERROR, "%s cannot be set after the end", name);
    else if (kind == PARAMETER && instance->state.phase == STEPPING)
        say(instance, ERROR, "%s is a parameter, which must be set before the initialisation has ended", name);
    else
        return true;
    return false;
}

/* Return whether a value is within its bounds; say so if it is not. */
static bool is_within(const Instance *instance, const char *name, const char *unit, double value, double least,
                      double most)
{
    if (value >= least && value <= most)
        return true;
    say(instance, ERROR, "%s must be within [%g, %g]%s%s, got %g", name, least, most, *unit ? " " : "", unit, value);
    return false;
}

/* Return whether a reference is one of a type's; say so if it is not. */
static bool is_known(const Instance *instance, const char *type, uint32_t reference, uint32_t first, uint32_t count)
{
    if (reference >= first && reference - first < count)
        return true;
    say(instance, ERROR, "%s must have value references from %u to %u, got %u", type, (unsigned)first,
        (unsigned)(first + count - 1), (unsigned)reference);
    return false;
}

Status instance_set_numbers(Instance *instance, const uint32_t references[], size_t count, const double values[])
{
    for (size_t k = 0; k < count; k++) {
        uint32_t at = references[k];
        if (!is_known(instance, "real variables", at, 0, NUMBERS) ||
            !is_settable(instance, number_names[at], number_kinds[at]) ||
            !is_within(instance, number_names[at], number_units[at], values[k], least_numbers[at], most_numbers[at]))
            return ERROR;
    }
    for (size_t k = 0; k < count; k++)
        instance->state.numbers[references[k]] = values[k];
    instance->state.is_current = 0;
    return OK;
}

Status instance_set_integers(Instance *instance, const uint32_t references[], size_t count, const int32_t values[])
{
    for (size_t k = 0; k < count; k++) {
        uint32_t at = references[k] - NUMBERS;
        if (!is_known(instance, "integer variables", references[k], NUMBERS, INTEGERS) ||
            !is_settable(instance, integer_names[at], PARAMETER) ||
            !is_within(instance, integer_names[at], "", values[k], least_integers[at], most_integers[at]))
            return ERROR;
    }
    for (size_t k = 0; k < count; k++)
        instance->state.integers[references[k] - NUMBERS] = values[k];
    instance->state.is_current = 0;
    return OK;
}

Status instance_get_numbers(Instance *instance, const uint32_t references[], size_t count, double values[])
{
    for (size_t k = 0; k < count; k++)
        if (references[k] != TIME && !is_known(instance, "real variables", references[k], 0, NUMBERS))
            return ERROR;
    if (instance->state.phase == INITIALISING || instance->state.phase == STEPPING)
        look(instance);
    for (size_t k = 0; k < count; k++)
        values[k] = references[k] == TIME ? instance_time(instance) : instance->state.numbers[references[k]];
    return OK;
}

Status instance_get_integers(Instance *instance, const uint32_t references[], size_t count, int32_t values[])
{
    for (size_t k = 0; k < count; k++)
        if (!is_known(instance, "integer variables", references[k], NUMBERS, INTEGERS))
            return ERROR;
    for (size_t k = 0; k < count; k++)
        values[k] = instance->state.integers[references[k] - NUMBERS];
    return OK;
}

double instance_time(const Instance *instance)
{
    return instance->state.start + instance->state.steps * PERIOD;
}

Status instance_step(Instance *instance, double point, double step)
{
    State *state = &instance->state;
    double count = floor(step / PERIOD + 0.5), now = instance_time(instance);
    if (state->phase != STEPPING)
        return say(instance, ERROR, "a step comes after the initialisation and before the end");
    if (state->has_ended)
        return say(instance, ERROR, "the episode has ended at %g s; a reset begins another one", now);
    if (!(fabs(point - now) <= 0.5 * PERIOD))
        return say(instance, ERROR, "the communication point must be %g s, got %g s", now, point);
    if (!(count >= 1.0 && count <= LONGEST && fabs(step / PERIOD - count) <= TOLERANCE * count))
        return say(instance, ERROR, "a communication step must be a multiple of the control period, %g s, up to %g s, "
                   "got %g s", PERIOD, LONGEST * PERIOD, step);
    for (int32_t left = (int32_t)count; left > 0 && !state->has_ended; left--) {
        state->has_ended = !model_step(instance->memory, state->numbers);
        state->steps++;
    }
    state->is_current = 1;
    if (state->has_ended)
        say(instance, OK, "the episode has ended at %g s", instance_time(instance));
    return OK;
}

size_t instance_saved_size(void)
{
    return sizeof(Saved) + MODEL_STATE_SIZE;
}

static Status allocate(const Instance *instance, void **saved)
{
    if (!*saved)
        *saved = malloc(instance_saved_size());
    return *saved ? OK : say(instance, ERROR, "there is not enough memory");
}

Status instance_save(Instance *instance, void **saved)
{
    Saved head;
    if (allocate(instance, saved) != OK)
        return ERROR;
    memset(&head, 0, sizeof head);
    head.digest = DIGEST;
    head.state = instance->state;
    memcpy(*saved, &head, sizeof head);
    memcpy((unsigned char *)*saved + sizeof head, instance->memory + MODEL_STATE, MODEL_STATE_SIZE);
    return OK;
}

Status instance_restore(Instance *instance, const void *saved)
{
    if (!saved)
        return say(instance, ERROR, "a state must be given");
    memcpy(&instance->state, (const unsigned char *)saved + offsetof(Saved, state), sizeof instance->state);
    memcpy(instance->memory + MODEL_STATE, (const unsigned char *)saved + sizeof(Saved), MODEL_STATE_SIZE);
    return OK;
}

Status instance_free_saved(Instance *instance, void **saved)
{
    (void)instance;
    if (saved) {
        free(*saved);
        *saved = NULL;
    }
    return OK;
}

Status instance_write(Instance *instance, const void *saved, unsigned char bytes[], size_t size)
{
    if (!saved || size < instance_saved_size())
        return say(instance, ERROR, "a state takes %u bytes, got %u", (unsigned)instance_saved_size(), (unsigned)size);
    memcpy(bytes, saved, instance_saved_size());
    return OK;
}

Status instance_read(Instance *instance, const unsigned char bytes[], size_t size, void **saved)
{
    uint64_t digest = 0;
    if (size == instance_saved_size())
        memcpy(&digest, bytes, sizeof digest);
    if (digest != DIGEST)
        return say(instance, ERROR, "a state must be of this unit, got %u bytes of something else", (unsigned)size);
    if (allocate(instance, saved) != OK)
        return ERROR;
    memcpy(*saved, bytes, size);
    return OK;
}

Status instance_refuse(const Instance *instance, const char *function)
{
    return say(instance, ERROR, "%s is not a function that this unit has", function);
}
