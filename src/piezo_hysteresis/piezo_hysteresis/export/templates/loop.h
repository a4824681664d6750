/* One tick: writes the voltage for it [V], which is finite, within the limits and no further from the
 * last one than the slew allows, whatever the input. Answers 0, or the sum of
 *   1   the reference was no number or absurd: the last one is held
 *   2   the measurement was no number and not used
 *   4   the voltage was out of range
 *   8   the voltage would have moved too fast
 *   16  what was computed is no number: the last voltage is held
 *   32  the voltage is slowed down to keep the mean power
 * or -2 where the state was never initialised; the voltage is then the one within the limits nearest to 0. */
int {{ name }}_step({{ name }}_state *state, const {{ name }}_input *input, double *voltage);
