-- States are the numbers of State::ALL: 0 queued, 1 running, 2 and more have ended.
--
-- Indexed text has the collation "C", the order of its bytes, which is the same on every system.
CREATE TABLE jobs (
    id uuid NOT NULL PRIMARY KEY,
    owner text COLLATE "C" NOT NULL,
    state smallint NOT NULL,
    attempt integer NOT NULL,
    -- Counts the claims. A worker with an older fence changes nothing.
    fence bigint NOT NULL,
    -- Of a running job: when its lease expires. Of a queued job: until when a node has reserved it
    -- for its last attempt.
    lease_end timestamptz,
    cancel_requested boolean NOT NULL,
    -- The client's idempotency key, and the digest of the content it was used with.
    idempotency_key text COLLATE "C",
    fingerprint bytea,
    -- The parameters of the mesh as a query string.
    options text NOT NULL,
    image_digest bytea NOT NULL,
    image_bytes bigint NOT NULL,
    image_shape text NOT NULL,
    progress text,
    progress_at timestamptz,
    mesh text,
    mesh_digest bytea,
    problem text,
    created_at timestamptz NOT NULL,
    started_at timestamptz,
    finished_at timestamptz,
    expires_at timestamptz,
    revision bigint NOT NULL,
    -- Four numbers for each change of state: revision, milliseconds since 1970, state, attempt.
    history bigint[] NOT NULL
);
-- Serves claims in the order of owners, limits of owners, expired leases and all lists.
CREATE INDEX jobs_by_state ON jobs (state, owner, id);
CREATE INDEX jobs_queued ON jobs (created_at) WHERE state = 0;
CREATE INDEX jobs_expiring ON jobs (expires_at) WHERE expires_at IS NOT NULL;
CREATE INDEX jobs_with_image ON jobs (image_digest) WHERE state < 2;
CREATE INDEX jobs_with_mesh ON jobs (mesh_digest) WHERE mesh_digest IS NOT NULL;
CREATE UNIQUE INDEX jobs_idempotency_keys ON jobs (owner, idempotency_key)
    WHERE idempotency_key IS NOT NULL;

-- Expired jobs, for which clients get 410 instead of 404.
CREATE TABLE gone (
    id uuid NOT NULL PRIMARY KEY,
    owner text COLLATE "C" NOT NULL,
    until timestamptz NOT NULL
);
CREATE INDEX gone_until ON gone (until);

-- Rows to lock while the jobs of an owner are counted: purpose 0 for submissions, 1 for claims.
CREATE TABLE owner_locks (
    owner text COLLATE "C" NOT NULL,
    purpose smallint NOT NULL,
    PRIMARY KEY (owner, purpose)
);

-- The numbers of queued and running jobs are sums over these rows. Each transaction changes one row
-- at random, so that few transactions wait for each other.
CREATE TABLE job_counts (
    slot integer NOT NULL PRIMARY KEY,
    queued bigint NOT NULL,
    running bigint NOT NULL
);
INSERT INTO job_counts SELECT slot, 0, 0 FROM generate_series(0, 63) AS slots (slot);

-- Blobs that no job may use any more: a job released them, or a node was about to store them.
CREATE TABLE orphan_candidates (
    blob bytea NOT NULL PRIMARY KEY,
    -- From when on a sweep may delete the blob if no job uses it.
    eligible_at timestamptz NOT NULL,
    -- A sweep is deleting the blob. If it is not done at eligible_at, another sweep may go on.
    deleting boolean NOT NULL DEFAULT false
);
CREATE INDEX orphan_candidates_eligible ON orphan_candidates (eligible_at);

-- Values that nodes share: the mean duration of attempts, and a row that each sweep writes to check
-- that the database takes writes.
CREATE TABLE shared_values (
    name text NOT NULL PRIMARY KEY,
    value double precision NOT NULL,
    at timestamptz NOT NULL
);
