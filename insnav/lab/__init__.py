"""The bench: from what is measured in the laboratory to known errors of sensors, each with its uncertainty."""
