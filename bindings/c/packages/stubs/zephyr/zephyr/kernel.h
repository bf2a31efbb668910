/* A stand-in for a header of Zephyr. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define __aligned(n) __attribute__((aligned(n)))
typedef struct {
	int ticks;
} k_timeout_t;
#define K_FOREVER ((k_timeout_t){-1})
