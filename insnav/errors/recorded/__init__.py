"""The recorded half of an error budget: free-inertial windows of a drive, what was predicted, and why they differ."""
