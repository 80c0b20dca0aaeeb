// Creates the container `pixmesh` of the emulator's account, which object_store cannot do.
import { createHmac } from "node:crypto";

const [port] = process.argv.slice(2);
const account = "devstoreaccount1";
const key = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw==";
const headers = { "x-ms-date": new Date().toUTCString(), "x-ms-version": "2021-08-06" };
const signed = [
  "PUT", ...Array(11).fill(""),
  `x-ms-date:${headers["x-ms-date"]}`, `x-ms-version:${headers["x-ms-version"]}`,
  `/${account}/${account}/pixmesh`, "restype:container",
].join("\n");
const signature = createHmac("sha256", Buffer.from(key, "base64")).update(signed).digest("base64");
headers.authorization = `SharedKey ${account}:${signature}`;
const address = `http://127.0.0.1:${port}/${account}/pixmesh?restype=container`;
const answer = await fetch(address, { method: "PUT", headers });
if (answer.status !== 201) throw new Error(`${answer.status}: ${await answer.text()}`);
