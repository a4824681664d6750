/* Tracks a sine with {{ name }} against the exported plant, whose parameters differ by 0.2 % from those of
 * the model, as those of an actuator do. Needs nothing but this folder. */
#include <math.h>
#include <stdio.h>

#include "{{ name }}.h"

static const double PI = 3.14159265358979323846;
static const double SECONDS = 12.0, JUDGED = 1.0;

/* Fill in the reference of one tick: a sine that is eased in over a second. */
static void reference(long tick, {{ name }}_input *input) {
    const double t = tick / {{ name.upper() }}_RATE, w = 2.0 * PI * {{ drive.frequency }};
    const double s = t < 1.0 ? t : 1.0;
    const double g = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    const double gv = s < 1.0 ? 30.0 * s * s * (1.0 - s) * (1.0 - s) : 0.0;
    const double ga = s < 1.0 ? 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) : 0.0;
    const double d = {{ drive.amplitude }} * sin(w * t), v = {{ drive.amplitude }} * w * cos(w * t);
    input->displacement = g * d + {{ drive.middle }};
    input->velocity = gv * d + g * v;
    input->acceleration = ga * d + 2.0 * gv * v - g * w * w * d;
    input->frequency = {{ drive.frequency }};
    input->phase = w * t;
}

static double noise(unsigned long long *seed) { /* about 3 nm rms, as of a good sensor */
    *seed = *seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return ((double)(*seed >> 11) / 9007199254740992.0 - 0.5) * 1e-8;
}

/* Run 0: reference over gain. Run 1: feedforward. Run 2: everything. */
static int track(int run, double *rms) {
    {{ name }}_parameters p;
    {{ name }}_state state;
    {{ name }}_plant_parameters plant;
    {{ name }}_plant_state actuator;
    {{ name }}_input input = {0};
    unsigned long long seed = 1;
    const double everything = run == 2 ? 1.0 : 0.0;
    double voltage = 0.0, displacement = 0.0, sum = 0.0;
    long tick, count = 0;
    const long last = (long)(SECONDS * {{ name.upper() }}_RATE), from = (long)((SECONDS - JUDGED) * {{ name.upper() }}_RATE);

    (void)everything;
    {{ name }}_defaults(&p);
{{ off }}
    {{ name }}_plant_defaults(&plant);
{{ moves }}
    if ({{ name }}_init(&state, &p) || {{ name }}_plant_init(&actuator, &plant)) return 1;
    for (tick = 0; tick < last; tick++) {
        reference(tick, &input);
        input.measured = displacement;
        input.age = 1.0;
        if ({{ name }}_step(&state, &input, &voltage) < 0) return 1;
        if (run == 0) voltage = {{ drive.centre }} + (input.displacement - {{ drive.middle }}) / {{ drive.gain }};
        if ({{ name }}_plant_step(&actuator, voltage, &displacement)) return 1;
        displacement += noise(&seed);
        if (tick >= from) {
            const double e = displacement - input.displacement;
            sum += e * e;
            count++;
        }
    }
    *rms = sqrt(sum / (double)count);
    return 0;
}

int main(void) {
    static const char *const names[] = {"no compensation", "feedforward", "feedforward + {{ links | join(', ') }}"};
    double rms[3];
    int run, falls = 1;
    printf("tracking %g Hz at %g Hz, rms error\n", {{ drive.frequency }}, {{ name.upper() }}_RATE);
    for (run = 0; run < {{ 3 if links else 2 }}; run++) {
        if (track(run, &rms[run])) return 2;
        printf("  %-36s %10.4f um\n", names[run], 1e6 * rms[run]);
        if (run > 0 && !(rms[run] < rms[run - 1])) falls = 0;
    }
    return falls ? 0 : 1;
}
