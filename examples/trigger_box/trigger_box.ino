// Trigger box for fringeworks, protocol 1 (fringeworks.devices.trigger_box). For an Arduino Uno:
// pin 8 makes pulses, pin 2 counts them (the camera's exposure output), pin 9 dims a lamp.
const int OUT = 8, IN = 2, LAMP = 9;
volatile unsigned long seen = 0;
unsigned long left = 0, made = 0, period = 0, width = 0, next = 0;
char text[40];
byte used = 0;

void count() { seen++; }
void setup() {
  Serial.begin(115200);
  pinMode(OUT, OUTPUT); pinMode(LAMP, OUTPUT); pinMode(IN, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(IN), count, RISING);
}
void done() { left = 0; Serial.print("done "); Serial.println(made); }
void obey() {
  unsigned long n = 0, p = 0, w = 0;
  if (text[0] == '?') { Serial.println("fringeworks-trigger 1"); }
  else if (text[0] == 'S') { Serial.println("ok"); if (left) done(); }
  else if (text[0] == 'C') { noInterrupts(); n = seen; seen = 0; interrupts(); Serial.print("count "); Serial.println(n); }
  else if (text[0] == 'L' && sscanf(text + 1, "%lu", &n) == 1) { if (n > 255) Serial.println("error range"); else { analogWrite(LAMP, n); Serial.println("ok"); } }
  else if (text[0] == 'P' && sscanf(text + 1, "%lu %lu %lu", &n, &p, &w) == 3) {
    if (left) { Serial.println("error busy"); return; }
    if (n < 1 || n > 10000 || w < 20 || p < 20 || w > p - 20) { Serial.println("error range"); return; }
    Serial.println("ok"); left = n; made = 0; period = p; width = w; next = micros() + 1000;
  }
  else if (used) { Serial.println("error command"); }
}

void loop() {
  if (left && (long)(micros() - next) >= 0) {
    unsigned long rise = micros();
    digitalWrite(OUT, HIGH); while (micros() - rise < width) {} digitalWrite(OUT, LOW);
    next += period; made++; if (--left == 0) done();
  } else if (Serial.available()) {
    char c = Serial.read();
    if (c == '\n') { text[used] = 0; obey(); used = 0; }
    else if (used < sizeof(text) - 1 && c != '\r') text[used++] = c;
  }
}
