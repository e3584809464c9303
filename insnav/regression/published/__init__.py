"""Published outage figures compared with simulated replicas of their tests."""
