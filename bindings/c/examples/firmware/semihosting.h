/* Files of the computer that runs the emulator, by Arm's semihosting calls. A board has a camera and a
   serial port in their place. */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stddef.h>
#include <stdint.h>

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT_EXTENDED = 0x20 };
enum { MODE_READ_BINARY = 1, MODE_WRITE_BINARY = 5 };

static inline intptr_t semihosting(uintptr_t call, const void *arguments) {
#ifdef __riscv
    register uintptr_t a0 __asm__("a0") = call;
    register const void *a1 __asm__("a1") = arguments;
    __asm__ volatile(".option push\n"
                     ".option norvc\n"
                     ".balign 16\n"
                     "slli x0, x0, 0x1f\n"
                     "ebreak\n"
                     "srai x0, x0, 7\n"
                     ".option pop"
                     : "+r"(a0)
                     : "r"(a1)
                     : "memory");
    return (intptr_t)a0;
#else
    register uintptr_t r0 __asm__("r0") = call;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return (intptr_t)r0;
#endif
}

/* Opens a file. Returns its handle, or -1. */
static inline intptr_t file_open(const char *name, size_t name_bytes, uintptr_t mode) {
    const uintptr_t arguments[3] = {(uintptr_t)name, mode, name_bytes};
    return semihosting(SYS_OPEN, arguments);
}

/* Reads bytes. Returns whether all of them were there. */
static inline int file_read(intptr_t file, void *to, size_t bytes) {
    const uintptr_t arguments[3] = {(uintptr_t)file, (uintptr_t)to, bytes};
    return semihosting(SYS_READ, arguments) == 0;
}

static inline void file_write(intptr_t file, const void *from, size_t bytes) {
    const uintptr_t arguments[3] = {(uintptr_t)file, (uintptr_t)from, bytes};
    (void)semihosting(SYS_WRITE, arguments);
}

/* Ends the emulator with a status. */
_Noreturn static inline void end(int status) {
    const uintptr_t application_exit = 0x20026;
    const uintptr_t arguments[2] = {application_exit, (uintptr_t)status};
    (void)semihosting(SYS_EXIT_EXTENDED, arguments);
    for (;;) {
    }
}

#endif
