/* Compares {{ name }} with what the kernels in Python answered, and tries to lead it out of its limits.
 * With --exact anything but the same bits fails; otherwise what another C library rounds otherwise may
 * differ by 1e-12 of the range of the voltage. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "{{ name }}.h"
#include "vectors.h"

#define INPUTS ({{ axes }} * 7)

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
    double voltages[{{ axes }}], dv = 0.0;
    int k, i, same = 0;
    expect({{ name }}_defaults(&p) == 0 && {{ name }}_init(&state, &p) == 0, "the defaults begin a state");
    for (k = 0; k < VECTORS; k++) {
        int equal = 1;
        {{ name }}_input inputs[{{ axes }}];
        memcpy(inputs, vectors[k], sizeof inputs);
        expect({{ name }}_step(&state, inputs, voltages) >= 0, "a step is made");
        for (i = 0; i < {{ axes }}; i++) {
            dv = fmax(dv, fabs(voltages[i] - vectors[k][INPUTS + i]));
            equal &= voltages[i] == vectors[k][INPUTS + i];
        }
        same += equal;
    }
    printf("%d of %d ticks have the same bits; largest difference %g V\n", same, VECTORS, dv);
    expect(same == VECTORS || (!exact && dv <= 1e-12 * (p.axis_1_high - p.axis_1_low)),
           "the library answers what the kernels answer");
}

static double wild(unsigned long long *seed) {
    *seed = *seed * 6364136223846793005ULL + 1442695040888963407ULL;
    switch ((*seed >> 33) % 16) {
        case 0: return NAN;
        case 1: return INFINITY;
        case 2: return -1e300;
        case 3: return 1.0;
        default: return ((double)(*seed >> 11) / 9007199254740992.0 - 0.5) * 1e-4;
    }
}

static void abuse(void) {
    {{ name }}_parameters p, wrong;
    {{ name }}_state state;
    {{ name }}_input inputs[{{ axes }}];
    unsigned long long seed = 7;
    double voltages[{{ axes }}], last[{{ axes }}] = {0.0};
    const double *limits = (const double *)&p;
    long k;
    int i, sound = 1;
    {{ name }}_defaults(&p);
    memset(&state, 0, sizeof state);
    memset(inputs, 0, sizeof inputs);
    expect({{ name }}_step(&state, inputs, voltages) == -2, "a state that was never initialised is refused");
    wrong = p;
    wrong.axis_1_slew = -1.0;
    expect({{ name }}_init(&state, &wrong) == -102, "a slew below 0 is refused");
    wrong = p;
    wrong.axis_1_low = p.axis_1_high;
    expect({{ name }}_init(&state, &p) == 0 && {{ name }}_set(&state, &wrong) == -3, "an empty range is refused");
    for (k = 0; k < 100000 && sound; k++) {
        double *each = (double *)inputs;
        unsigned n;
        for (n = 0; n < INPUTS; n++) each[n] = wild(&seed);
        for (i = 0; i < {{ axes }}; i++) {
            if (k % 3) inputs[i].age = 1.0;
            if (k % 7) inputs[i].frequency = 20.0;
        }
        {{ name }}_step(&state, inputs, voltages);
        for (i = 0; i < {{ axes }}; i++) {
            const double low = limits[3 * i], high = limits[3 * i + 1], slew = limits[3 * i + 2];
            sound &= voltages[i] >= low && voltages[i] <= high;
            sound &= fabs(voltages[i] - last[i]) <= slew / {{ name.upper() }}_RATE * (1.0 + 1e-12) + 1e-12;
            last[i] = voltages[i];
        }
    }
    expect(sound, "whatever comes in, the voltages keep their limits");
    expect({{ name }}_reset(&state) == 0, "a state goes back to rest");
}

int main(int count, char **words) {
    compare(count > 1 && !strcmp(words[1], "--exact"));
    abuse();
    puts(failed ? "self-test failed" : "self-test passed");
    return failed;
}
