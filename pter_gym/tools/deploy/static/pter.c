/* $title

   Made by pter_gym from the Python functions of the same names, with the same operations in the same order.
   Compile with -std=c99: contracting a product and a sum into one operation would change bits. */

#include <float.h>

#include "pter.h"

/* what only this file knows has names of its own, so that another such file may be in the same translation unit */
$hidden

#if PTER_DIGEST != 0x$digest
#error "pter.h is of another policy: take both files of one export"
#endif

#if FLT_RADIX != 2 || FLT_MANT_DIG != 24
#error "float must have 32 bits (IEEE 754)"
#elif ${limits}_MANT_DIG != $digits
#error "$real must have $bits bits (IEEE 754); pter export --numbers float needs only those of float"
#endif

/* an array of a negative size where a type has another */
typedef char size_of_float[sizeof(float) == sizeof(uint32_t) ? 1 : -1];
typedef char size_of_real[sizeof(pter_real) == sizeof(uint${bits}_t) ? 1 : -1];

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define INFINITE ((real)1.0 / (real)0.0)
#define NOT_A_NUMBER ((real)0.0 / (real)0.0)

/* whether x is no NaN, and whether it is within ± most, in words that an analyser follows */
#define IS_NUMBER(x) ((x) == (x))
#define IS_WITHIN(x, most) (IS_NUMBER(x) && (x) > -(most) && (x) < (most))

#define MOST_TURNED ((real)1e6) /* largest angle that has a sine [rad] */

typedef pter_real real;

static real magnitude(real x)
{
    return x > 0 ? x : 0 - x;
}

static real larger(real x, real y)
{
    return y > x ? y : x;
}

static real smaller(real x, real y)
{
    return y < x ? y : x;
}

/* Return the square root: a guess from the number's bits, Newton's method, and half a correction by the exact
   remainder. Below the square of what matters in a machine, it is 0. */
static real square_root(real x)
{
    union {
        real value;
        uint${bits}_t bits;
    } guess, high;
    if (!(x > (real)1e-30)) {
        return 0;
    }
    guess.value = x;
    guess.bits = UINT${bits}_C($magic) - (guess.bits >> 1);
    real y = guess.value;
    for (int k = 0; k < 4; k++) {
        y = y * ((real)1.5 - (real)0.5 * x * y * y);
    }
    real root = x * y;
    high.value = root;
    high.bits = high.bits >> $low << $low;
    real low = root - high.value;
    real rest = ((x - high.value * high.value) - 2 * high.value * low) - low * low;
    return root + (real)0.5 * y * rest;
}

$translated

$path

void pter_reset(pter_state *state)
{
    /*@ loop unroll PTER_MEMORY; */
    for (int k = 0; k < PTER_MEMORY; k++) {
        state->memory[k] = 0;
    }
    for (int k = 0; k < 4; k++) {
        state->volts[k] = 0;
    }
    state->held = 0;
    state->arc = 0;
}

int32_t pter_count(int32_t before, uint32_t counter, int bits)
{
    uint32_t half = UINT32_C(1) << (bits - 1);
    uint32_t change = ((counter - (uint32_t)before + half) & (2 * half - 1)) - half;
    return (int32_t)((uint32_t)before + change);
}

void pter_encoder(pter_reading *reading, int link, int32_t count, int32_t before, real resolution, real zero)
{
    int32_t change = (int32_t)((uint32_t)count - (uint32_t)before);
    Encoder found = encoder(count, change, resolution, zero, PTER_PERIOD);
    reading->angle[link] = found.theta;
    reading->velocity[link] = found.omega;
}

void pter_observe(pter_state *state, const pter_reading *reading, const pter_path *path,
                  float observation[PTER_ENTRIES])
{
    const real *t = reading->torque;
    const float *v = state->volts;
    real seen[$most];
    Reading r = {{reading->angle[0], reading->angle[1]}, {reading->velocity[0], reading->velocity[1]},
                 {t[0], t[1], t[2], t[3]}, {reading->force[0], reading->force[1]}};
    PerClutch volts = {v[0], v[1], v[2], v[3]};
    int known = IS_NUMBER(r.omega.a) && IS_NUMBER(r.omega.b) && IS_NUMBER(r.force.along) && IS_NUMBER(r.force.across);
    for (int k = 0; k < 4; k++) {
        known = known && IS_NUMBER(t[k]);
    }
    if (state->arc >= path->count) {
        state->arc = 0; /* of a path that had more */
    }
    if (known && path->count > 0 && IS_WITHIN(r.theta.a, MOST_TURNED) && IS_WITHIN(r.theta.b, MOST_TURNED)) {
        state->arc = observe(r, volts, path->arcs, path->count, state->arc, path->pace, seen);
    } else {
        /*@ loop unroll $most; */
        for (int k = 0; k < $most; k++) {
            seen[k] = NOT_A_NUMBER;
        }
    }
    /*@ loop unroll PTER_ENTRIES; */
    for (int k = 0; k < PTER_ENTRIES; k++) {
        observation[k] = (float)seen[k];
    }
}

void pter_act(pter_state *state, const float observation[PTER_ENTRIES], float volts[4])
{
    int known = 1;
    /*@ loop unroll PTER_ENTRIES; */
    for (int k = 0; k < PTER_ENTRIES; k++) {
        known = known && IS_NUMBER(observation[k]);
    }
    if (!known) {
        state->held = 0;
        for (int k = 0; k < 4; k++) {
            state->volts[k] = 0;
        }
    } else {
        if (state->held == 0) {
            PerClutch found = command(observation, state->memory, PTER_VOLTAGE_MAX);
            state->volts[0] = IS_NUMBER(found.x1) ? (float)found.x1 : 0;
            state->volts[1] = IS_NUMBER(found.x2) ? (float)found.x2 : 0;
            state->volts[2] = IS_NUMBER(found.x3) ? (float)found.x3 : 0;
            state->volts[3] = IS_NUMBER(found.x4) ? (float)found.x4 : 0;
        }
        state->held = (state->held + 1) % PTER_HOLD;
    }
    for (int k = 0; k < 4; k++) {
        volts[k] = state->volts[k];
    }
}

$shown
