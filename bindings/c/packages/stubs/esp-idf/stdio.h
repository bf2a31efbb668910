/* A stand-in for the header of a libc. */
#pragma once
int printf(const char *, ...);
