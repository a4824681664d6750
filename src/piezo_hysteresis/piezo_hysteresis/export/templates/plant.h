/* One tick: takes the voltage that is held over it [V] and writes the displacement [m] that belongs to
 * the tick. Answers 0, 16 where the voltage is no number and the last one is held, or -2. */
int {{ name }}_step({{ name }}_state *state, double voltage, double *displacement);
