/* Time of single steps of {{ name }}; with seconds as the first word a loop by the clock at its rate. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "{{ name }}.h"

static {{ name }}_state state;
static {{ name }}_plant_state plant;
static {{ name }}_input input;
static double displacement, cosine = 1.0, sine;

static long long now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static void reference(long tick) { /* a turn by a small angle: no sine in the time that is measured */
    const double w = 2.0 * 3.14159265358979323846 * {{ drive.frequency }}, a = w / {{ name.upper() }}_RATE;
    static double ca, sa;
    if (tick == 0) ca = cos(a), sa = sin(a), cosine = 1.0, sine = 0.0;
    input.displacement = {{ drive.amplitude }} * sine + {{ drive.middle }};
    input.velocity = {{ drive.amplitude }} * w * cosine;
    input.acceleration = -{{ drive.amplitude }} * w * w * sine;
    input.frequency = {{ drive.frequency }};
    input.phase = a * tick;
    input.measured = displacement;
    input.age = 1.0;
    const double turned = cosine * ca - sine * sa;
    sine = sine * ca + cosine * sa;
    cosine = turned;
}

static int begin(void) {
    {{ name }}_parameters p;
    {{ name }}_plant_parameters q;
    {{ name }}_defaults(&p);
    {{ name }}_plant_defaults(&q);
    return {{ name }}_init(&state, &p) || {{ name }}_plant_init(&plant, &q);
}

static int by_the_clock(double seconds) {
    const long long period = (long long)(1e9 / {{ name.upper() }}_RATE + 0.5);
    const long ticks = (long)(seconds * {{ name.upper() }}_RATE);
    long long next = now() + 1000000, worst = 0, jitter_sum = 0;
    long tick, late = 0, judged = 0;
    double voltage, sum = 0.0;
    for (tick = 0; tick < ticks; tick++, next += period) {
        struct timespec t = {next / 1000000000LL, next % 1000000000LL};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL)) {}
        const long long woke = now() - next;
        reference(tick);
        {{ name }}_step(&state, &input, &voltage);
        {{ name }}_plant_step(&plant, voltage, &displacement);
        if (now() - next > period) late++;
        if (woke > worst) worst = woke;
        jitter_sum += woke;
        if (tick > ticks / 2) {
            const double e = displacement - input.displacement;
            sum += e * e;
            judged++;
        }
    }
    printf("{\"ticks\": %ld, \"late\": %ld, \"mean_wake_ns\": %.1f, \"worst_wake_ns\": %lld, "
           "\"rms_m\": %.17g}\n", ticks, late, (double)jitter_sum / ticks, worst, sqrt(sum / judged));
    return 0;
}

static int compare(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

int main(int count, char **words) {
    const long steps = count > 2 ? atol(words[2]) : 10000000;
    if (begin()) return 2;
    if (count > 1 && atof(words[1]) > 0.0) return by_the_clock(atof(words[1]));
    float *times = malloc(sizeof(float) * steps);
    double voltage, total = 0.0;
    long tick;
    if (!times) return 2;
    const long long first = now();
    for (tick = 0; tick < steps; tick++) {
        reference(tick);
        const long long started = now();
        {{ name }}_step(&state, &input, &voltage);
        times[tick] = (float)(now() - started);
        total += times[tick];
        {{ name }}_plant_step(&plant, voltage, &displacement);
    }
    const double whole = (double)(now() - first) / steps; /* with the plant and the clock */
    qsort(times, steps, sizeof(float), compare);
    printf("{\"steps\": %ld, \"median_ns\": %.0f, \"p999_ns\": %.0f, \"worst_ns\": %.0f, "
           "\"mean_ns\": %.1f, \"loop_ns\": %.1f}\n", steps, times[steps / 2], times[(long)(0.999 * steps)],
           times[steps - 1], total / steps, whole);
    free(times);
    return 0;
}
