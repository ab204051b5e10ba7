"""Benchmarks over many surfaces, to be run by hand: robustness and quality against rivals. Nothing imports them."""
