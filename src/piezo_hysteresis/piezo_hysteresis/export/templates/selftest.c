/* Compares {{ name }} with what the kernels in Python answered, and tries to lead it out of its limits.
 * With --exact anything but the same bits fails; otherwise what another C library rounds otherwise may
 * differ by 1e-12 of the stroke, and of the range of the voltage. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "{{ name }}.h"
#include "vectors.h"

static int failed;

static void expect(int holds, const char *what) {
    if (!holds) {
        printf("FAILED: %s\n", what);
        failed = 1;
    }
}

static void compare(int exact) {
    {{ name }}_parameters p;
    {{ name }}_state state;
    {{ name }}_plant_parameters q;
    {{ name }}_plant_state plant;
    double voltage = 0.0, displacement = 0.0, dv = 0.0, dy = 0.0;
    int k, same = 0;
    expect({{ name }}_defaults(&p) == 0 && {{ name }}_init(&state, &p) == 0, "the defaults begin a state");
    expect({{ name }}_plant_defaults(&q) == 0 && {{ name }}_plant_init(&plant, &q) == 0, "and a plant");
    for (k = 0; k < VECTORS; k++) {
        {{ name }}_input input;
        memcpy(&input, vectors[k], 5 * sizeof(double));
        input.measured = displacement;
        input.age = 1.0;
        expect({{ name }}_step(&state, &input, &voltage) >= 0, "a step is made");
        {{ name }}_plant_step(&plant, voltage, &displacement);
        dv = fmax(dv, fabs(voltage - vectors[k][5]));
        dy = fmax(dy, fabs(displacement - vectors[k][6]));
        same += voltage == vectors[k][5] && displacement == vectors[k][6];
    }
    printf("%d of %d ticks have the same bits; largest difference %g V, %g m\n", same, VECTORS, dv, dy);
    expect(same == VECTORS || (!exact && dv <= 1e-12 * (p.limits_high - p.limits_low) &&
                               dy <= 1e-12 * {{ stroke }}), "the library answers what the kernels answer");
}

static double wild(unsigned long long *seed) {
    *seed = *seed * 6364136223846793005ULL + 1442695040888963407ULL;
    switch ((*seed >> 33) % 16) {
        case 0: return NAN;
        case 1: return INFINITY;
        case 2: return -1e300;
        case 3: return 1.0;
        default: return ((double)(*seed >> 11) / 9007199254740992.0 - 0.5) * 4.0 * {{ stroke }};
    }
}

static void abuse(void) {
    {{ name }}_parameters p, wrong;
    {{ name }}_state state;
    {{ name }}_input input;
    unsigned long long seed = 7;
    double voltage = NAN, last;
    long k;
    {{ name }}_defaults(&p);
    memset(&state, 0, sizeof state);
    memset(&input, 0, sizeof input);
    expect({{ name }}_step(&state, &input, &voltage) == -2, "a state that was never initialised is refused");
    expect(voltage >= p.limits_low && voltage <= p.limits_high, "and answered with a safe voltage");
    wrong = p;
    wrong.limits_slew = -1.0;
    expect({{ name }}_init(&state, &wrong) == -102, "a slew below 0 is refused");
    wrong = p;
    wrong.limits_low = NAN;
    expect({{ name }}_init(&state, &wrong) == -100, "limits that are no number are refused");
    wrong = p;
    wrong.limits_low = p.limits_high;
    expect({{ name }}_init(&state, &p) == 0 && {{ name }}_set(&state, &wrong) == -3, "an empty range is refused");
    last = fmin(fmax(0.0, p.limits_low), p.limits_high);
    for (k = 0; k < 200000; k++) {
        double *each = (double *)&input;
        unsigned i;
        for (i = 0; i < sizeof input / sizeof(double); i++) each[i] = wild(&seed);
        if (k % 3) input.age = 1.0;
        if (k % 7) input.frequency = 20.0;
        {{ name }}_step(&state, &input, &voltage);
        if (!(voltage >= p.limits_low && voltage <= p.limits_high)) break;
        if (!(fabs(voltage - last) <= p.limits_slew / {{ name.upper() }}_RATE * (1.0 + 1e-12) + 1e-12)) break;
        last = voltage;
    }
    expect(k == 200000, "whatever comes in, the voltage keeps its limits");
    expect({{ name }}_reset(&state) == 0, "a state goes back to rest");
}

int main(int count, char **words) {
    compare(count > 1 && !strcmp(words[1], "--exact"));
    abuse();
    puts(failed ? "self-test failed" : "self-test passed");
    return failed;
}
