/* Compares the plant of {{ name }} with what the kernels in Python answered; --exact wants the same bits. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "{{ name }}.h"
#include "vectors.h"

int main(int count, char **words) {
    const int exact = count > 1 && !strcmp(words[1], "--exact");
    {{ name }}_plant_parameters q;
    {{ name }}_plant_state plant;
    double displacement, dy = 0.0;
    int k, same = 0, failed;
    if ({{ name }}_plant_defaults(&q) || {{ name }}_plant_init(&plant, &q)) return 1;
    for (k = 0; k < VECTORS; k++) {
        if ({{ name }}_plant_step(&plant, vectors[k][5], &displacement)) return 1;
        dy = fmax(dy, fabs(displacement - vectors[k][6]));
        same += displacement == vectors[k][6];
    }
    printf("%d of %d ticks have the same bits; largest difference %g m\n", same, VECTORS, dy);
    failed = !(same == VECTORS || (!exact && dy <= 1e-12 * {{ stroke }}));
    failed |= {{ name }}_plant_step(&plant, NAN, &displacement) != 16;
    puts(failed ? "self-test failed" : "self-test passed");
    return failed;
}
