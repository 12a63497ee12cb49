// plantfit's recorder on an Arduino Uno or Nano (ATmega328P). `make -C firmware sketch` puts the whole sketch together.
extern "C" {
#include "recorder.h"
}
void hal_begin();

void setup()
{
    hal_begin();
    recorder_start();
}

void loop()
{
    recorder_poll();
}
