/* What startup-riscv.S needs from C. */
#include <stdint.h>

#include "semihosting.h"

extern uint32_t _stack_end[], _stack_start[];
_Noreturn void end_with(int status);
uint32_t stack_bytes(void);

_Noreturn void end_with(int status) {
    end(status);
}

/* Returns the most bytes of stack that were in use so far. */
uint32_t stack_bytes(void) {
    const volatile uint32_t *word = _stack_end;
    while ((const uint32_t *)word < _stack_start && *word == 0x5aa5a55a) {
        word++;
    }
    return (uint32_t)((uintptr_t)_stack_start - (uintptr_t)word);
}
