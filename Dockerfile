# Builds the service into an image that holds the program, the C library it was linked with, the
# certificates of public authorities, a list of what was compiled in, and nothing else: no shell, no
# package manager. It runs as a user without rights and writes to /data alone.
#
#   docker build -t pixmesh .
#   docker run --rm --read-only -p 127.0.0.1:8080:8080 -p 127.0.0.1:8081:8081 \
#     -v pixmesh-data:/data pixmesh
#
# Nothing here depends on the processor: docker buildx build --platform linux/amd64,linux/arm64 ...
# deploy/container/verify builds and runs the image without a container engine.

ARG RUST_VERSION=1.95

FROM docker.io/library/rust:${RUST_VERSION}-bookworm AS toolchain
WORKDIR /pixmesh

# What is compiled in, as CycloneDX has it.
FROM toolchain AS materials
ARG CYCLONEDX_VERSION=0.5.9
RUN --mount=type=cache,id=pixmesh-registry,target=/usr/local/cargo/registry \
    cargo install --locked --quiet "cargo-cyclonedx@${CYCLONEDX_VERSION}"
COPY . .
ARG SOURCE_DATE_EPOCH=0
RUN --mount=type=cache,id=pixmesh-registry,target=/usr/local/cargo/registry \
    SOURCE_DATE_EPOCH=$SOURCE_DATE_EPOCH cargo cyclonedx --manifest-path Cargo.toml \
        --format json --spec-version 1.5 --override-filename materials \
    && mv materials.json /pixmesh.cdx.json

FROM toolchain AS build
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
COPY . .
# The commit that /metrics names: --build-arg COMMIT=$(git rev-parse --short HEAD)
ARG COMMIT=unknown
RUN --mount=type=cache,id=pixmesh-registry,target=/usr/local/cargo/registry \
    --mount=type=cache,id=pixmesh-target,target=/pixmesh/target \
    PIXMESH_COMMIT=$COMMIT cargo build --release --locked --bin pixmesh \
    && install -D target/release/pixmesh /image/usr/local/bin/pixmesh
# The libraries it is linked with, under the names and paths by which it looks for them, and what the C
# library needs to find hosts and users by name.
RUN ldd /image/usr/local/bin/pixmesh | grep -o '/[^ ]*' \
      | xargs -I{} install -D {} /image{} \
    && install -D -m 644 /etc/ssl/certs/ca-certificates.crt -t /image/etc/ssl/certs \
    && install -d -o 65532 -g 65532 /image/data /image/tmp \
    && echo 'pixmesh:x:65532:65532::/data:/nowhere' > /image/etc/passwd \
    && echo 'pixmesh:x:65532:' > /image/etc/group \
    && echo 'hosts: files dns' > /image/etc/nsswitch.conf

FROM scratch
ARG VERSION=unknown
ARG COMMIT=unknown
LABEL org.opencontainers.image.title="pixmesh" \
      org.opencontainers.image.description="HTTP microservice that turns pictures into triangle meshes" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0" \
      org.opencontainers.image.version="${VERSION}" \
      org.opencontainers.image.revision="${COMMIT}"
COPY --from=build /image /
COPY --from=materials /pixmesh.cdx.json /usr/share/pixmesh/materials.cdx.json
USER 65532:65532
# Inside a container every address is reached from outside: whoever publishes the port decides who
# may use it. The allocator returns memory at once.
ENV PATH=/usr/local/bin \
    MIMALLOC_PURGE_DELAY=0 \
    PIXMESH_LISTEN=0.0.0.0:8080 \
    PIXMESH_OPS_LISTEN=0.0.0.0:8081 \
    PIXMESH_DATA_DIR=/data \
    PIXMESH_INSECURE_NO_AUTH=true
WORKDIR /data
VOLUME /data
EXPOSE 8080 8081
HEALTHCHECK --interval=10s --timeout=3s --start-period=5s CMD ["/usr/local/bin/pixmesh", "health"]
ENTRYPOINT ["/usr/local/bin/pixmesh"]
CMD ["serve"]
