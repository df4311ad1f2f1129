"""How a figure is told: beside the test's name, and into the report."""

import pytest


@pytest.fixture
def tell(request, record_property):
    """Print a figure beside the test's name, and put it into the report with its unit."""
    plugins = request.config.pluginmanager
    reporter, capture = plugins.get_plugin("terminalreporter"), plugins.get_plugin("capturemanager")

    def told(name, value, unit):
        record_property(f"{name} [{unit}]", value)
        with capture.global_and_fixture_disabled():
            reporter.ensure_newline()
            reporter.write_line(f"  {name}: {value:.3g} {unit}")

    return told
