/* What is known {% if axes %}of one axis {% endif %}in a tick. */
typedef struct {
    double displacement; /* wanted [m] */
    double velocity;     /* its derivative [m/s] */
    double acceleration; /* and that of the velocity [m/s^2] */
    double frequency;    /* fundamental of the reference [Hz], 0 for none */
    double phase;        /* its accumulated phase [rad] */
    double measured;     /* displacement [m]; not a number where there is none */
    double age;          /* steps since it was measured: 1 where the last step's voltage is the newest */
} {{ name }}_input;
