"""What the columns of a table mean: names, units, axes, order, overlap."""
