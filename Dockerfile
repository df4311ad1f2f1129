# The service in a small image: built in one stage, run from another as a user of its own.
#   docker build -t safe-rrt-companion .
#   docker run --rm -v ./my-mission.yaml:/mission.yaml:ro --device /dev/ttyAMA0 safe-rrt-companion \
#       run /mission.yaml --link serial:///dev/ttyAMA0:921600
FROM python:3.11-slim-bookworm AS build
WORKDIR /src
COPY pyproject.toml README.md constraints.txt ./
COPY companion companion
COPY sim sim
RUN python -m venv /opt/companion \
    && /opt/companion/bin/pip install --no-cache-dir -c constraints.txt '.[sim]'

FROM python:3.11-slim-bookworm
COPY --from=build /opt/companion /opt/companion
COPY mission_configs /usr/share/companion/mission_configs
RUN useradd --system --create-home --groups dialout companion
USER companion
WORKDIR /home/companion
# Kernels are compiled here, so that the service starts planning at once.
ENV NUMBA_CACHE_DIR=/home/companion/.numba PATH=/opt/companion/bin:$PATH
RUN companion plan /usr/share/companion/mission_configs/first-flight.yaml
ENTRYPOINT ["companion"]
CMD ["--help"]
