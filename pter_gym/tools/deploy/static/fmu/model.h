/* What a unit computes: an episode with the arm, alone or with its policy, or a policy alone.

   A model is MODEL_MEMORY bytes at a multiple of MODEL_ALIGNMENT; those from MODEL_STATE on, MODEL_STATE_SIZE of
   them, are all that changes of it. */

#ifndef PTER_MODEL_H
#define PTER_MODEL_H

#include <stddef.h>
#include <stdint.h>

extern const size_t MODEL_MEMORY, MODEL_STATE, MODEL_STATE_SIZE;

#define MODEL_ALIGNMENT 64

void model_prepare(unsigned char *model);

/* Begin an episode, as its parameters say, and write the outputs. */
void model_begin(unsigned char *model, double numbers[], const int32_t integers[]);

/* Write the outputs that depend on the inputs at once. */
void model_look(unsigned char *model, double numbers[]);

/* Run a control step and write the outputs; return whether the episode goes on. */
int model_step(unsigned char *model, double numbers[]);

#endif
