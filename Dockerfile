# docker build --tag advercity .
FROM debian:12-slim

# make and git for setting up; the certificates for a proxy's or a mirror's HTTPS.
RUN apt-get update && apt-get install --yes --no-install-recommends \
      ca-certificates git make python3 python3-venv
COPY . /opt/advercity
WORKDIR /opt/advercity
RUN make setup && .venv/bin/advercity assets install --allow-failure \
    && .venv/bin/advercity compile library --output compiled

ENV PATH=/opt/advercity/.venv/bin:$PATH
WORKDIR /data
ENTRYPOINT ["advercity"]
