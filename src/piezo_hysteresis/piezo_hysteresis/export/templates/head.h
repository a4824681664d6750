/* {{ name }}: model {{ model }} ({{ chain }}) as a C library, {{ short_rate }} Hz, {{ target }}.
 *
 * {{ links }}
 * Written by piezo_hysteresis {{ version }} from a model with the fingerprint {{ fingerprint }}. Export it anew
 * instead of editing it.
 *
 * No function allocates, locks, blocks or calls anything but the mathematical functions of the C
 * library; all memory is in the structs, so that any number of loops run beside each other. SI units.
 */
#ifndef {{ upper }}_H
#define {{ upper }}_H

#ifdef __cplusplus
extern "C" {
#endif

#define {{ upper }}_VERSION "{{ version }}"
#define {{ upper }}_FINGERPRINT "{{ fingerprint }}"
#define {{ upper }}_RATE {{ rate }} /* steps per second [Hz] */

/* Answers of init, set and reset: 0, or
 *   -2        the state was never initialised
 *   -3        these numbers are impossible together (low above high, a model without an inverse)
 *   -100 - k  number k of the struct is no number, out of range, or only a new export changes it
 * After any of them everything is as it was. */
