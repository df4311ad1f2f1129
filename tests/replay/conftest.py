"""``pytest tests/replay --update-refs`` renews the references; look at the diff before committing it."""


def pytest_addoption(parser):
    parser.addoption("--update-refs", action="store_true", help="write the references anew")
