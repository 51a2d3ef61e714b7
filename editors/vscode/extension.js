// Starts the language server `rvaft lsp` for trees.
const { workspace } = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

function activate() {
  const settings = workspace.getConfiguration("rvaft");
  const server = { command: settings.get("command"), args: settings.get("arguments") };
  client = new LanguageClient("rvaft", "rvaft", server, {
    documentSelector: [{ language: "rvaft" }],
    initializationOptions: { log: settings.get("log") },
    synchronize: { configurationSection: "rvaft" },
  });
  return client.start();
}

function deactivate() {
  return client && client.stop();
}

module.exports = { activate, deactivate };
