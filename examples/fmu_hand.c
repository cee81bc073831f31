/* A hand as the model of an FMU, for fmu_hand.py: a spring to a point that moves at 0.25 m/s, and a
   damper. */

#include "model.h"

enum { X, Y, VX, VY, FX, FY }; /* the variables in their order */

struct hand {
    double time, x, y; /* and where the point was at the beginning */
};

const size_t MODEL_MEMORY = sizeof(struct hand), MODEL_STATE = 0, MODEL_STATE_SIZE = sizeof(struct hand);

void model_prepare(unsigned char *model)
{
    (void)model;
}

void model_look(unsigned char *model, double v[])
{
    const struct hand *hand = (void *)model;
    v[FX] = 300.0 * (hand->x + 0.25 * hand->time - v[X]) + 15.0 * (0.25 - v[VX]);
    v[FY] = 300.0 * (hand->y - v[Y]) - 15.0 * v[VY];
}

void model_begin(unsigned char *model, double v[], const int32_t whole[])
{
    struct hand *hand = (void *)model;
    (void)whole;
    hand->time = 0.0;
    hand->x = v[X];
    hand->y = v[Y];
    model_look(model, v);
}

int model_step(unsigned char *model, double v[])
{
    struct hand *hand = (void *)model;
    hand->time += 0.01;
    model_look(model, v);
    return 1;
}
