/* $NAME$: model $MODEL$ ($CHAIN$) as a C library, $SHORT_RATE$ Hz, $TARGET$.
 *
 * $LINKS$
 * Written by piezo_hysteresis $VERSION$ from a model with the fingerprint $FINGERPRINT$. Export it anew
 * instead of editing it.
 *
 * No function allocates, locks, blocks or calls anything but the mathematical functions of the C
 * library; all memory is in the structs, so that any number of loops run beside each other. SI units.
 */
#ifndef $UPPER$_H
#define $UPPER$_H

#ifdef __cplusplus
extern "C" {
#endif

#define $UPPER$_VERSION "$VERSION$"
#define $UPPER$_FINGERPRINT "$FINGERPRINT$"
#define $UPPER$_RATE $RATE$ /* steps per second [Hz] */

/* Answers of init, set and reset: 0, or
 *   -2        the state was never initialised
 *   -3        these numbers are impossible together (low above high, a model without an inverse)
 *   -100 - k  number k of the struct is no number, out of range, or only a new export changes it
 * After any of them everything is as it was. */
