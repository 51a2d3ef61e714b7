"""Extending Attack-Fault Trees with Runtime Verification (FMAS 2022)."""
