"""Calibration of single sensors: the rate table and the tumble test."""
