"""How fast CRUISE is: `python -m benchmarks [--quick] [--json]`. `docs/performance.md` defines every number."""
