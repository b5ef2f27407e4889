"""Lines of JSON as a sensor sends them."""

FOREVER_S = 240.0  # a hang: nothing here takes so long, also beside other programs on a slow machine


HEAD = [2.1, 0.3, 0.4]


QUAT = [1.0, 0.0, 0.0, 0.0]
