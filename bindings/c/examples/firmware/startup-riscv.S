/* From reset to main() on a RISC-V of 32 bits: the stack, the FPU, the memory. */
.section .init, "ax"
.global reset
reset:
    la sp, _stack_start
    la t0, fault
    csrw mtvec, t0
#ifdef __riscv_flen
    li t0, 1 << 13              /* mstatus.FS: the FPU is on */
    csrs mstatus, t0
#endif
    la t0, _bss_start
    la t1, _bss_end
1:  bgeu t0, t1, 2f
    sw zero, 0(t0)
    addi t0, t0, 4
    j 1b
2:  la t0, _stack_end           /* paint, for stack_bytes() */
    li t1, 0x5aa5a55a
3:  bgeu t0, sp, 4f
    sw t1, 0(t0)
    addi t0, t0, 4
    j 3b
4:  call main
    call end_with
.balign 4
fault:
    li a0, 101
    call end_with
