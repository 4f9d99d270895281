"""Training: samples → network → losses → weights."""
