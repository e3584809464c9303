"""All compiled code: functions over plain arrays in SI and radians; no input or output, no logging."""
