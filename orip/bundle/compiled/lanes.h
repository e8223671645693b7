/* Several numbers computed at once: a vector where the compiler has vectors, else a single double. */

#ifndef ORIP_LANES_H
#define ORIP_LANES_H

#if defined(__GNUC__)
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

#define PADDED(count) (((count) + LANES - 1) / LANES * LANES)
#define ALL(number) ((Lanes){0} + (number))

#define AT(doubles) (*(Lanes *)(doubles))
#define LANE(lanes, number) (((double *)&(lanes))[number])

#endif
