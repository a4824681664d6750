#define {{ upper }}_AXES {{ axes }}

/* One tick of all axes: takes {{ axes }} inputs and writes {{ axes }} voltages [V], which are finite, within
 * the limits and no further from the last ones than the slew allows, whatever the input. Answers 0, or the sum of
 *   1   a reference was no number or absurd: the last one is held
 *   2   a measurement was no number and not used
 *   4   a voltage was out of range
 *   8   a voltage would have moved too fast
 *   16  what was computed is no number: the last voltage is held
 * or -2 where the state was never initialised; the voltages are then 0. */
int {{ name }}_step({{ name }}_state *state, const {{ name }}_input *inputs, double *voltages);
