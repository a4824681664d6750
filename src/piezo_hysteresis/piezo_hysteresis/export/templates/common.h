/* Fill in what was exported. Answers 0. */
int {{ name }}_defaults({{ name }}_parameters *parameters);
/* Begin a state at rest. */
int {{ name }}_init({{ name }}_state *state, const {{ name }}_parameters *parameters);
/* Change parameters between two steps; the voltage goes over smoothly. */
int {{ name }}_set({{ name }}_state *state, const {{ name }}_parameters *parameters);
/* Back to rest with the parameters in force. */
int {{ name }}_reset({{ name }}_state *state);
