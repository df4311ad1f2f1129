"""``pytest tests/service/replay --update-refs`` renews the references; look at the diff before a commit."""


def pytest_addoption(parser):
    parser.addoption("--update-refs", action="store_true", help="write the references anew")
