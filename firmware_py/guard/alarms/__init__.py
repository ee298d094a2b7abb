"""What every alarm is made of: limit, standing condition, weight of evidence, rate of events."""
