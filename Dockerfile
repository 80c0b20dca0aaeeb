# Builds the service and runs it as a user without rights.
#
#   docker build -t pixmesh .
#   docker run --rm -p 8080:8080 -p 8081:8081 -v pixmesh-data:/data pixmesh

FROM rust:1.95-bookworm AS build
WORKDIR /pixmesh
COPY . .
# The commit that /metrics names: --build-arg COMMIT=$(git rev-parse --short HEAD)
ARG COMMIT=unknown
RUN PIXMESH_COMMIT=$COMMIT cargo build --release --locked --bin pixmesh && mkdir /data

FROM debian:bookworm-slim
COPY --from=build /pixmesh/target/release/pixmesh /usr/local/bin/pixmesh
COPY --from=build --chown=65532:65532 /data /data
USER 65532:65532
# Inside a container every address is reached from outside: whoever publishes the port decides who
# may use it.
ENV PIXMESH_LISTEN=0.0.0.0:8080 \
    PIXMESH_OPS_LISTEN=0.0.0.0:8081 \
    PIXMESH_DATA_DIR=/data \
    PIXMESH_INSECURE_NO_AUTH=true
VOLUME /data
EXPOSE 8080 8081
HEALTHCHECK --interval=10s --timeout=3s CMD ["pixmesh", "health"]
ENTRYPOINT ["pixmesh"]
CMD ["serve"]
