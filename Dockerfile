# The demo in a container:
#   docker build -t piezo_hysteresis .
#   docker run --rm -v "$PWD/out:/piezo_hysteresis/out" piezo_hysteresis
FROM python:3.11-bookworm
RUN apt-get update \
    && apt-get install -y --no-install-recommends gcc g++ make cmake \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /piezo_hysteresis
COPY . .
RUN make setup
CMD ["make", "demo"]
