// Counts what exported C computes: each floating-point operation of pter.c, for readings on standard input.
//
// A row there is a pter_reading and an observation, as in deploy.c; a row of the output the operations and, among
// them, the divisions of its control step.

#include <float.h>
#include <stdint.h>
#include <stdio.h>
#include <type_traits>

static uint32_t operations, divisions;

template <class T> struct Counted {
    T value;
    Counted() = default;
    template <class U, class = std::enable_if_t<std::is_arithmetic_v<U>>> Counted(U number) : value((T)number) {}
    template <class U> explicit(sizeof(T) < sizeof(U)) Counted(Counted<U> other) : value((T)other.value) {}
    template <class U, class = std::enable_if_t<std::is_integral_v<U>>> explicit operator U() const { return (U)value; }
};

template <class T> T plain(Counted<T> x) { return x.value; }
template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>> T plain(T x) { return x; }
template <class A, class B> constexpr bool counts = !(std::is_arithmetic_v<A> && std::is_arithmetic_v<B>);
template <class T> Counted<T> result(T x) { return x; }
static bool result(bool x) { return x; }

#define COUNT(OP, DIVIDES) \
    template <class A, class B, class = std::enable_if_t<counts<A, B>>> auto operator OP(A x, B y) \
    { \
        operations += 1; \
        divisions += DIVIDES; \
        return result(plain(x) OP plain(y)); \
    }
COUNT(+, 0) COUNT(-, 0) COUNT(*, 0) COUNT(/, 1)
COUNT(<, 0) COUNT(>, 0) COUNT(<=, 0) COUNT(>=, 0) COUNT(==, 0) COUNT(!=, 0)
template <class T> Counted<T> operator-(Counted<T> x)
{
    operations += 1;
    return -x.value;
}

#define float Counted<float>
#define double Counted<double>
#include "pter.c"
#undef float
#undef double

static struct {
    double reading[10];
    float observation[PTER_ENTRIES];
} row;

int main()
{
    pter_state state;
    pter_path path = {pter_path_arcs, PTER_ARCS, (pter_real)0.25};
    pter_reset(&state);
    while (fread(&row, sizeof row, 1, stdin)) {
        pter_reading reading = {};
        Counted<float> observation[PTER_ENTRIES], volts[4];
        int at[2] = {(int)(1e4 * row.reading[0]), (int)(1e4 * row.reading[1])};
        for (int k = 0; k < 4; k++) {
            reading.torque[k] = row.reading[4 + k];
        }
        operations = divisions = 0;
        pter_encoder(&reading, 0, at[0], at[0] - 9, 1e-4, 0);
        pter_encoder(&reading, 1, at[1], at[1] + 9, 1e-4, 0);
        pter_observe(&state, &reading, &path, observation);
        for (int k = 0; k < PTER_ENTRIES; k++) {
            observation[k] = row.observation[k];
        }
        pter_act(&state, observation, volts);
        uint32_t counts[] = {operations, divisions};
        fwrite(counts, sizeof counts, 1, stdout);
    }
}
