"""How good a registrar is: metrics, tables, pictures."""
