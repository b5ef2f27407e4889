"""Lines of JSON as a sensor sends them."""

FOREVER_S = 30.0  # nothing here takes so long, on whatever machine


HEAD = [2.1, 0.3, 0.4]


QUAT = [1.0, 0.0, 0.0, 0.0]
