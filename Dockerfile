# The service in a small image: built in one stage, run from another as a user of its own.
#   docker build -t safe-rrt-companion .
#   docker run --rm --device /dev/ttyAMA0 -v ./my-mission.yaml:/etc/companion/mission.yaml:ro \
#       -v companion-flights:/var/lib/companion safe-rrt-companion \
#       run /etc/companion/mission.yaml --link serial:///dev/ttyAMA0:921600
# Nothing here depends on the processor: `docker buildx build --platform linux/amd64,linux/arm64` makes both.
# packaging/prove_image.py carries out these very steps in a clean Debian, without a registry.
FROM python:3.11-slim-bookworm AS build
WORKDIR /src
COPY pyproject.toml README.md constraints.txt ./
COPY companion companion
# Left out at the end: the installer, the libraries' own tests, and dialects of MAVLink that nothing reads.
RUN --mount=type=cache,target=/root/.cache/pip python -m venv /opt/companion \
    && /opt/companion/bin/pip install --quiet --no-compile -c constraints.txt '.[metrics,plot]' \
    && /opt/companion/bin/pip uninstall --yes pip setuptools \
    && cd /opt/companion/lib/python3*/site-packages \
    && find . -type d -name tests -prune -exec rm -rf {} + \
    && find pymavlink/dialects -name '*.py' ! -name __init__.py ! -path '*/v20/ardupilotmega.py' -delete

FROM python:3.11-slim-bookworm
RUN useradd --system --create-home --home-dir /var/lib/companion --groups dialout companion \
    && install -d -o companion -g companion /var/cache/companion
COPY --from=build /opt/companion /opt/companion
COPY mission_configs /usr/share/companion/mission_configs
# Kernels are compiled here, so that the service plans at once. They are for any processor of the
# architecture: compiled for the one that builds the image, they would not be used on another.
ENV PATH=/opt/companion/bin:$PATH NUMBA_CACHE_DIR=/var/cache/companion NUMBA_CPU_NAME=generic \
    COMPANION_METRICS=9105 PYTHONUNBUFFERED=1
USER companion
WORKDIR /var/lib/companion
RUN companion warm-up /usr/share/companion/mission_configs/first-flight.yaml
# Asks the planning loop, not the process: one that hangs is unhealthy.
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s --retries=3 CMD ["companion", "health"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["companion"]
CMD ["--help"]
