"""What the words of a column's name say: an input, an output, a set point, a counter (English, German, French)."""

import re

import numpy as np

from plantfit.recording.readers.columns import Column

_PARTS = re.compile(r"[A-Za-zÄÖÜäöüßéèêàçôîùÉ]+")
_INPUT = re.compile(
    r"(?:u|in|inp|input|volt|volts|voltage|pwm|duty|heater|heating|heat|valve|pump|fan|cmd|command|control|controller|co|mv|op|actuator|act|drive|"
    r"motor|throttle|torque|tau|force|excitation|stimulus|power|q|ain|dac|ao|eingang|spannung|ventil|pumpe|heizung|heizer|heizleistung|"
    r"stellgröße|stellgrad|stellwert|leistung|lüfter|drehmoment|tension|commande|vanne|pompe|chauffage|puissance|entrée|entree)"
)
_OUTPUT = re.compile(
    r"(?:y|out|temp|temperature|speed|rpm|velocity|vel|omega|w|position|pos|angle|theta|phi|level|height|pressure|flow|pv|"
    r"response|tacho|encoder|enc|displacement|acceleration|acc|concentration|ph|humidity|current|i|t|x|outlet|level|adc|"
    r"drehzahl|temperatur|geschwindigkeit|winkel|füllstand|niveau|druck|durchfluss|istwert|ist|ausgang|strom|lage|weg|"
    r"température|vitesse|mesure|sortie|pression|débit|courant|angle)"
)
_MEASURED = re.compile(r"(?:meas|measured|measurement|sensor|output)")  # where no other word tells
GOAL = re.compile(r"(?:sp|set|setpoint|setpt|ref|reference|target|desired|des|soll|sollwert|consigne|goal|setvalue)")
COUNT = re.compile(r"(?:index|idx|sample|samples|no|nr|num|number|row|count|counter|n|k|record|point|unnamed|scan|id|seq|messpunkt|lfd)")


def said(column: Column, words: re.Pattern[str]) -> bool:
    """Whether one word of the name is among these."""
    return any(words.fullmatch(word) for word in _words(column))


def named(column: Column) -> float:
    """1 where the name is that of an input, -1 of an output, 0 of neither."""
    words = [(1.0 if _INPUT.fullmatch(w) else -1.0) for w in _words(column) if bool(_INPUT.fullmatch(w)) != bool(_OUTPUT.fullmatch(w))]
    if not words and said(column, _MEASURED):
        words = [1.0 if said(column, re.compile("output")) and column.unit == "%" else -1.0]  # the output of a controller
    return float(np.sign(words[-1] if sum(words) == 0 else sum(words))) if words else 0.0


def told_by_name(column: Column) -> bool:
    """Whether a word of the name is that of a signal."""
    return any(said(column, words) for words in (_INPUT, _OUTPUT, _MEASURED, GOAL))


def _words(column: Column) -> list[str]:
    return [w.lower() for w in _PARTS.findall(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column.name.rpartition(".")[2] or column.name))]
