/* Fill in what was exported. Answers 0. */
int $NAME$_defaults($NAME$_parameters *parameters);
/* Begin a state at rest. */
int $NAME$_init($NAME$_state *state, const $NAME$_parameters *parameters);
/* Change parameters between two steps; the voltage goes over smoothly. */
int $NAME$_set($NAME$_state *state, const $NAME$_parameters *parameters);
/* Back to rest with the parameters in force. */
int $NAME$_reset($NAME$_state *state);
