/* An instance of a unit: variables, phases and messages, whatever version of FMI an importer speaks. */

#ifndef PTER_INSTANCE_H
#define PTER_INSTANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "data.h"
#include "model.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

typedef enum { OK, WARNING, DISCARD, ERROR } Status;

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

/* All that changes besides the model; plain bytes. */
typedef struct {
    double numbers[NUMBERS];
    double start;                 /* communication point at which the simulation has begun [s] */
    int32_t integers[INTEGERS + 1];
    int32_t phase, steps;         /* control steps since then */
    int32_t is_current, has_ended; /* whether outputs are those of the inputs; whether the episode is over */
} State;

typedef struct Instance Instance;

struct Instance {
    State state;
    unsigned char *allocated, *memory; /* the model's */
    void *environment;
    void (*logger)(void);
    void (*tell)(const Instance *instance, Status status, const char *message);
    char *name;
    double begin; /* start time of the next simulation [s] */
    bool is_logging;
};

/* Return a new instance, or NULL. */
Instance *instance_new(const char *name, const char *token, void *environment, void (*logger)(void),
                       void (*tell)(const Instance *, Status, const char *), bool is_logging);

void instance_free(Instance *instance);
Status instance_reset(Instance *instance);
Status instance_begin(Instance *instance, double start);
Status instance_initialised(Instance *instance);
Status instance_terminate(Instance *instance);

Status instance_set_numbers(Instance *instance, const uint32_t references[], size_t count, const double values[]);
Status instance_get_numbers(Instance *instance, const uint32_t references[], size_t count, double values[]);
Status instance_set_integers(Instance *instance, const uint32_t references[], size_t count, const int32_t values[]);
Status instance_get_integers(Instance *instance, const uint32_t references[], size_t count, int32_t values[]);

/* Advance from a communication point by a step [s], which is a multiple of the control period; an episode
   that ends on the way ends the step. */
Status instance_step(Instance *instance, double point, double step);

/* Return the time that has been reached [s]. */
double instance_time(const Instance *instance);

/* All that changes of an instance as bytes, which any instance of the same unit takes. */
Status instance_save(Instance *instance, void **saved);
Status instance_restore(Instance *instance, const void *saved);
Status instance_free_saved(Instance *instance, void **saved);
Status instance_write(Instance *instance, const void *saved, unsigned char bytes[], size_t size);
Status instance_read(Instance *instance, const unsigned char bytes[], size_t size, void **saved);
size_t instance_saved_size(void);

/* Say that a function is not one that this unit has. */
Status instance_refuse(const Instance *instance, const char *function);

#endif
