/* From reset to main(): the vector table, the memory, the FPU. For Cortex-M; with no library of C. */
#include <stdint.h>

#include "semihosting.h"

extern uint32_t _data_start[], _data_end[], _data_source[], _bss_start[], _bss_end[], _stack_end[], _stack_start[];
int main(void);
_Noreturn void reset(void);

/* Paint of stack that was never used. */
enum { PAINT = 0x5aa5a55a };

_Noreturn static void fault(void) {
    end(101);
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[16] = {
    (uintptr_t)_stack_start,
    (uintptr_t)reset,
    [2] = (uintptr_t)fault,
    [3] = (uintptr_t)fault, /* a panic of the library comes here too: it ends in an undefined instruction */
    [4] = (uintptr_t)fault,
    [5] = (uintptr_t)fault,
    [6] = (uintptr_t)fault,
};

_Noreturn void reset(void) {
#ifdef __ARM_FP
    *(volatile uint32_t *)0xe000ed88 |= 0xfu << 20; /* CPACR: the FPU is on */
    __asm__ volatile("dsb\n isb");
#endif
    const uint32_t *from = _data_source;
    for (uint32_t *to = _data_start; to < _data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = _bss_start; to < _bss_end;) {
        *to++ = 0;
    }
    /* Below this function's own stack. */
    const uint32_t *top = (uint32_t *)__builtin_frame_address(0) - 16;
    for (volatile uint32_t *to = _stack_end; (const uint32_t *)to < top;) {
        *to++ = PAINT;
    }
    end(main());
}

/* Returns the most bytes of stack that were in use so far. */
uint32_t stack_bytes(void) {
    const volatile uint32_t *word = _stack_end;
    while ((const uint32_t *)word < _stack_start && *word == PAINT) {
        word++;
    }
    return (uint32_t)((uintptr_t)_stack_start - (uintptr_t)word);
}
