-- State numbers are those of State::ALL: 0 waits, 1 runs, 2 and more are ends.
--
-- Texts that indexes order are of the collation "C": its order is that of their bytes, on every
-- system and in every version of it.
CREATE TABLE jobs (
    id uuid NOT NULL PRIMARY KEY,
    owner text COLLATE "C" NOT NULL,
    state smallint NOT NULL,
    attempt integer NOT NULL,
    -- Counts the claims. A worker with an older fence changes nothing.
    fence bigint NOT NULL,
    -- Of a running job: when its lease ends. Of a waiting job: until when a node has reserved it to
    -- make its last attempt alone.
    lease_end timestamptz,
    cancel_requested boolean NOT NULL,
    -- The client's idempotency key.
    idempotency_key text COLLATE "C",
    -- What must be the same in a repeated submission.
    fingerprint bytea,
    order_query text NOT NULL,
    image_digest bytea NOT NULL,
    image_bytes bigint NOT NULL,
    image_shape text NOT NULL,
    stage text,
    fraction double precision,
    progress_at timestamptz,
    mesh text,
    mesh_digest bytea,
    problem text,
    created_at timestamptz NOT NULL,
    started_at timestamptz,
    finished_at timestamptz,
    expires_at timestamptz,
    revision bigint NOT NULL,
    -- The changes of state, four numbers each: revision, milliseconds since 1970, state, attempt.
    history bigint[] NOT NULL
);
-- Serves claims in turns between owners, limits of owners, leases that ended, and all lists.
CREATE INDEX jobs_by_state ON jobs (state, owner, id);
CREATE INDEX jobs_waiting ON jobs (created_at) WHERE state = 0;
CREATE INDEX jobs_expiring ON jobs (expires_at) WHERE expires_at IS NOT NULL;
CREATE INDEX jobs_with_image ON jobs (image_digest) WHERE state < 2;
CREATE INDEX jobs_with_mesh ON jobs (mesh_digest) WHERE mesh_digest IS NOT NULL;
CREATE UNIQUE INDEX jobs_idempotency_keys ON jobs (owner, idempotency_key)
    WHERE idempotency_key IS NOT NULL;

-- Deleted jobs, for which clients get 410 and not 404 until a time.
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

-- The numbers of waiting and running jobs are sums over these rows. Each transaction changes one row at
-- random, so that few transactions wait for each other.
CREATE TABLE job_counts (
    slot integer NOT NULL PRIMARY KEY,
    queued bigint NOT NULL,
    running bigint NOT NULL
);
INSERT INTO job_counts SELECT slot, 0, 0 FROM generate_series(0, 63) AS slots (slot);

-- Blobs that may belong to no job: a job released them, or a node was about to store them.
CREATE TABLE given_up (
    blob bytea NOT NULL PRIMARY KEY,
    since timestamptz NOT NULL
);
CREATE INDEX given_up_since ON given_up (since);

-- Values that nodes share: the mean duration of jobs, and a row that each sweep writes to check that
-- the database takes writes.
CREATE TABLE shared_values (
    name text NOT NULL PRIMARY KEY,
    value double precision NOT NULL,
    at timestamptz NOT NULL
);
