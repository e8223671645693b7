/* Several numbers computed at once: a vector where the compiler has vectors (gcc, clang), else a single double (MSVC).
 *
 * ORIP_ONE_LANE makes gcc and clang compile what MSVC compiles, for tests. */

#ifndef ORIP_LANES_H
#define ORIP_LANES_H

#if defined(__GNUC__) && !defined(ORIP_ONE_LANE)
#define LANES 4
#define INLINE static inline __attribute__((always_inline))
/* the warning is about the ABI of functions that return vectors: here all of them are inline */
#pragma GCC diagnostic ignored "-Wpsabi"
/* aligned like a double, so that it can begin at any element of an array of doubles */
typedef double Lanes __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
/* element k of the array of each lane */
#define GATHERED(arrays, k) ((Lanes){(arrays)[0][k], (arrays)[1][k], (arrays)[2][k], (arrays)[3][k]})
#else
#define LANES 1
#define INLINE static inline
typedef double Lanes;
#define GATHERED(arrays, k) ((arrays)[0][k])
#endif

/* Loops for processors with AVX2 beside those for all. Not on Windows, where gcc does not align the stack for them. */
#if LANES == 4 && defined(__x86_64__) && !defined(_WIN32)
#define HAS_AVX2_LOOPS
#endif

/* Rows are padded to whole vectors of 4, with one lane too: loops of a known length (normals.h) read the padding. */
#define PADDED(count) (((count) + 3) / 4 * 4)
#define ALL(number) ((Lanes){0} + (number))

#define AT(doubles) (*(Lanes *)(doubles))
#define LANE(lanes, number) (((double *)&(lanes))[number])

#endif
