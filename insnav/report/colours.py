"""Colours of Okabe and Ito (2008), distinguishable with every common kind of colour vision and in grey print."""

BLUE, ORANGE, GREEN, VERMILLION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#000000", "#8A8A8A"
AXIS_COLOURS = (BLUE, VERMILLION, GREEN)  # x, y, z
