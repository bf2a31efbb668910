/* A stand-in for Arduino's header: what the sketches use of it, without a body. */
#pragma once
#include <stddef.h>
#include <stdint.h>

struct Printer {
  void begin(unsigned long);
  explicit operator bool();
  void print(const char *);
  void print(double);
  void println(const char *);
  void println();
};
void setup();
void loop();
inline void Printer::begin(unsigned long) {}
inline Printer::operator bool() { return true; }
inline void Printer::print(const char *) {}
inline void Printer::print(double) {}
inline void Printer::println(const char *) {}
inline void Printer::println() {}
static Printer Serial;
inline void delay(unsigned long) {}
