"""One sensor at a time: the rate table and the tumble test."""
