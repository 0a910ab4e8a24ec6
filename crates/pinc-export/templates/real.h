/* The type of all numbers: double or float (-DPINC_REAL=float), the same in all files. */
#ifndef PINC_REAL
#define PINC_REAL double
#endif
#define PINC_JOIN_TOKENS(a, b) a##b
#define PINC_JOIN(a, b) PINC_JOIN_TOKENS(a, b)
#define PINC_MATH_double(name) name
#define PINC_MATH_float(name) name##f
/* The function of libm for this type: PINC_MATH(tanh) is tanh or tanhf. */
#define PINC_MATH(name) PINC_JOIN(PINC_MATH_, PINC_REAL)(name)
/* A number of this type. */
#define PINC_N(value) ((PINC_REAL)(value))

