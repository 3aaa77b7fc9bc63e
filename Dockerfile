# docker build --tag advercity .
# npm only downloads the photographs that specs name; the image itself has none.
FROM debian:12-slim AS photographs
RUN apt-get update && apt-get install --yes --no-install-recommends ca-certificates npm \
    && npm pack @dgreenheck/ez-tree@1.1.0

FROM debian:12-slim

# make and git for setting up; the certificates for a proxy's or a mirror's HTTPS.
RUN apt-get update && apt-get install --yes --no-install-recommends \
      ca-certificates git make python3 python3-venv
COPY . /opt/advercity
WORKDIR /opt/advercity
COPY --from=photographs /dgreenheck-ez-tree-1.1.0.tgz /tmp
RUN make setup && .venv/bin/advercity assets install --from /tmp/dgreenheck-ez-tree-1.1.0.tgz \
    && .venv/bin/advercity assets install --allow-failure \
    && .venv/bin/advercity compile library --output compiled

ENV PATH=/opt/advercity/.venv/bin:$PATH
WORKDIR /data
ENTRYPOINT ["advercity"]
