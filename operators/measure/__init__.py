"""What measuring distances reads, shows and writes."""
