// An Arduino on standard input and output, for tests of the sketch: as many calls as it uses.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <poll.h>
#include <unistd.h>
typedef unsigned char byte;
enum { OUTPUT, INPUT_PULLUP, HIGH = 1, LOW = 0, RISING };
static void (*on_rise)() = nullptr;
static int level[20];
unsigned long micros() {
  using namespace std::chrono;
  static auto start = steady_clock::now();
  return (unsigned long)duration_cast<microseconds>(steady_clock::now() - start).count();
}
void pinMode(int, int) {}
// The output is wired to the input, so that the box counts its own pulses.
void digitalWrite(int pin, int value) { if (pin == 8 && value && !level[pin] && on_rise) on_rise(); level[pin] = value; }
void analogWrite(int, int) {}
int digitalPinToInterrupt(int pin) { return pin; }
void attachInterrupt(int, void (*f)(), int) { on_rise = f; }
void noInterrupts() {}
void interrupts() {}
struct Port {
  void begin(long) {}
  int available() { pollfd p{0, POLLIN, 0}; return poll(&p, 1, 0) > 0; }
  char read() { char c = 0; if (::read(0, &c, 1) <= 0) _exit(0); return c; }
  void print(const char *text) { (void)!write(1, text, strlen(text)); }
  void println(const char *text) { print(text); print("\r\n"); }
  void println(unsigned long n) { char t[24]; snprintf(t, 24, "%lu", n); println(t); }
} Serial;
#include SKETCH
int main() { setup(); while (true) loop(); }
