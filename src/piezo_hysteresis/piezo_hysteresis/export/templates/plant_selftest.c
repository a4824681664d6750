/* Compares the plant of NAME with what the kernels in Python answered; --exact wants the same bits. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "NAME.h"
#include "vectors.h"

int main(int count, char **words) {
    const int exact = count > 1 && !strcmp(words[1], "--exact");
    NAME_plant_parameters q;
    NAME_plant_state plant;
    double displacement, dy = 0.0;
    int k, same = 0, failed;
    if (NAME_plant_defaults(&q) || NAME_plant_init(&plant, &q)) return 1;
    for (k = 0; k < VECTORS; k++) {
        if (NAME_plant_step(&plant, vectors[k][5], &displacement)) return 1;
        dy = fmax(dy, fabs(displacement - vectors[k][6]));
        same += displacement == vectors[k][6];
    }
    printf("%d of %d ticks have the same bits; largest difference %g m\n", same, VECTORS, dy);
    failed = !(same == VECTORS || (!exact && dy <= 1e-12 * $STROKE));
    failed |= NAME_plant_step(&plant, NAN, &displacement) != 16;
    puts(failed ? "self-test failed" : "self-test passed");
    return failed;
}
