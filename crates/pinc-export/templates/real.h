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

/* Vectors of numbers that are computed side by side: as long as the processor's where the compiler
   has the extensions of GNU C, and else, or with -DPINC_VECTOR_BYTES=0, of one number. */
#ifndef PINC_VECTOR_BYTES
#if defined(__GNUC__) && defined(__AVX__)
#define PINC_VECTOR_BYTES 32
#elif defined(__GNUC__) && (defined(__SSE2__) || defined(__aarch64__))
#define PINC_VECTOR_BYTES 16
#else
#define PINC_VECTOR_BYTES 0
#endif
#endif
#if PINC_VECTOR_BYTES > 0
typedef PINC_REAL pinc_vector __attribute__((vector_size(PINC_VECTOR_BYTES), may_alias));
/* The same anywhere in an array. */
typedef PINC_REAL pinc_loose
    __attribute__((vector_size(PINC_VECTOR_BYTES), aligned(sizeof(PINC_REAL)), may_alias));
#define PINC_LANES ((int)(PINC_VECTOR_BYTES / sizeof(PINC_REAL)))
#else
typedef PINC_REAL pinc_vector;
typedef PINC_REAL pinc_loose;
#define PINC_LANES 1
#endif
