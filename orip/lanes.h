/* Several numbers computed at once: a vector where the compiler has vectors (gcc, clang), else a single double (MSVC).
 *
 * ORIP_ONE_LANE makes gcc and clang compile what MSVC compiles, for tests. */

#ifndef ORIP_LANES_H
#define ORIP_LANES_H

#include <math.h>

#if defined(__GNUC__) && !defined(ORIP_ONE_LANE)
#define LANES 4
#define INLINE static inline __attribute__((always_inline))
/* the warning is about the ABI of functions that return vectors: here all of them are inline */
#pragma GCC diagnostic ignored "-Wpsabi"
/* aligned like a double, so that it can begin at any element of an array of doubles */
typedef double Lanes __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
/* the same number in all lanes */
#define ALL(number) ((Lanes){(number), (number), (number), (number)})
/* of structures of lanes, so that none of them crosses a line of the cache */
#define IN_LINES __attribute__((aligned(64)))
/* element k of the array of each lane */
#define GATHERED(arrays, k) ((Lanes){(arrays)[0][k], (arrays)[1][k], (arrays)[2][k], (arrays)[3][k]})
/* what a comparison of lanes gives: all bits of a lane, or none */
typedef long long LaneNumbers __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
/* four lanes chosen from those of a (0 to 3) and of b (4 to 7) */
#ifdef __clang__
#define CHOSEN(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#else
#define CHOSEN(a, b, i, j, k, l) __builtin_shuffle(a, b, (LaneNumbers){i, j, k, l})
#endif
#else
#define LANES 1
#define IN_LINES
#define INLINE static inline
typedef double Lanes;
typedef long long LaneNumbers;
#define ALL(number) (number)
#define GATHERED(arrays, k) ((arrays)[0][k])
#endif

/* Fetch a line of memory that is needed soon, wherever the address leads. */
#if defined(__GNUC__)
#define FETCH(address) __builtin_prefetch(address)
#else
#define FETCH(address) ((void)(address))
#endif

/* Number of the lowest bit that is set; one is. */
INLINE int first_of(int bits)
{
#if defined(__GNUC__)
    return __builtin_ctz((unsigned)bits);
#else
    int first = 0;
    while (!(bits >> first & 1))
        first++;
    return first;
#endif
}

/* Loops for processors with AVX2 and FMA beside those for all. Not on Windows, where gcc does not align the stack for them. */
#if LANES == 4 && defined(__x86_64__) && !defined(_WIN32)
#define HAS_AVX2_LOOPS
#endif

/* Rows are padded by zeros to pairs of vectors of 4, with one lane too: sums of products are kept in pairs of registers. */
#define PADDED(count) (((count) + 7) / 8 * 8)

#define AT(doubles) (*(Lanes *)(doubles))
#define LANE(lanes, number) (((double *)&(lanes))[number])
#define LANE_NUMBER(lanes, number) (((long long *)&(lanes))[number])

/* In each lane a number where something holds, else another one. */
INLINE Lanes either(LaneNumbers holds, Lanes number, Lanes other)
{
#if LANES == 4
    return (Lanes)((holds & (LaneNumbers)number) | (~holds & (LaneNumbers)other));
#else
    return holds ? number : other;
#endif
}

/* Whether something holds in any lane. */
INLINE int in_any(LaneNumbers holds)
{
#if LANES == 4
    return (holds[0] | holds[1] | holds[2] | holds[3]) != 0;
#else
    return holds != 0;
#endif
}

INLINE Lanes root_of_each(Lanes number)
{
    Lanes root;
    for (int lane = 0; lane < LANES; lane++)
        LANE(root, lane) = sqrt(LANE(number, lane));
    return root;
}

INLINE Lanes larger_of_each(Lanes a, Lanes b) { return either(a > b, a, b); }
INLINE Lanes size_of_each(Lanes number) { return either(number < ALL(0.0), -number, number); }

/* Write as many numbers as there are lanes, each of a lane's, to the array of that lane. */
INLINE void spread(const Lanes *numbers, double *const *arrays)
{
#if LANES == 4
    const Lanes *n = numbers;
    const Lanes even_01 = CHOSEN(n[0], n[1], 0, 4, 2, 6), odd_01 = CHOSEN(n[0], n[1], 1, 5, 3, 7);
    const Lanes even_23 = CHOSEN(n[2], n[3], 0, 4, 2, 6), odd_23 = CHOSEN(n[2], n[3], 1, 5, 3, 7);
    AT(arrays[0]) = CHOSEN(even_01, even_23, 0, 1, 4, 5);
    AT(arrays[1]) = CHOSEN(odd_01, odd_23, 0, 1, 4, 5);
    AT(arrays[2]) = CHOSEN(even_01, even_23, 2, 3, 6, 7);
    AT(arrays[3]) = CHOSEN(odd_01, odd_23, 2, 3, 6, 7);
#else
    arrays[0][0] = numbers[0];
#endif
}

#endif
