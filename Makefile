# make demo    show it: sets up .venv, starts everything, builds two towers, compares belief with truth
# make test    ruff, mypy, all tests
# make test-ros  the bridge against real ROS 2, in an environment of its own that is set up once (300 MB)
# make lint    ruff and mypy only
# make docs    the documentation as a site in site/; broken links are errors
# make bench   dsr bench with all peers and plots: make bench ARGS="--quick"
# make clean   remove what these made, except the recordings in runs/
#
# PYTHON=/path/to/python3.11 chooses the interpreter; ARGS go to the demo: make demo ARGS="--seed 3"

.PHONY: demo test test-ros lint docs bench setup clean

demo: setup
	@.venv/bin/dsr demo $(ARGS)

# four workers on two cores: many tests wait for processes, not for a processor
# (the first line compiles them once instead of in each worker)
test: lint
	@.venv/bin/python -m pytest --collect-only -qq > /dev/null
	.venv/bin/python -m pytest -n 4 --dist worksteal --ignore=tests/ros

test-ros: setup
	@.ci/setup-ros
	.venv/bin/python -m pytest tests/ros -n 2

lint: setup
	.venv/bin/ruff check .
	.venv/bin/mypy
	.venv/bin/mypy --config-file pyproject.toml docs/hooks

docs: setup
	@NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict
	@echo "Open site/index.html. The search needs a server: .venv/bin/python -m http.server --directory site"

bench: setup
	@.venv/bin/python -m pip install --quiet --no-deps -r requirements-bench.lock
	@.venv/bin/dsr bench --json-file runs/bench/rows.json --plots runs/bench $(ARGS)

setup:
	@PYTHON="$(PYTHON)" .ci/setup

clean:
	rm -rf .venv .venv-ros site .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist dsr.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
