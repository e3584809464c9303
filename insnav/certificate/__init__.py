"""Certificate of the numerics: every integrator against closed forms and published values."""
